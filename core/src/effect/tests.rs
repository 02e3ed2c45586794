//! Tests every column against an independent computation: moving point masses, summed up by Newton and Euler.

mod body;
mod laws;
mod names;
