//! An empty library; the tests next to it each state their requirement.
