//! Every column against physics of another kind: point masses that are moved, summed up by Newton and Euler.

mod body;
mod laws;
mod names;
