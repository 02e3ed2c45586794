//! A person who does not exist, on the real wires, with physics of its own.
