//! The longest tests, each of a whole workflow: they start first, since tests start in the order of their names.

mod demo;
mod live;
mod plan;
mod random_kills;
mod reconcile_session;
mod two_plates;
