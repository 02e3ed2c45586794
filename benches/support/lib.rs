//! Common code of the benches: interleaved rounds, the dense textbook method, a worker who stands and holds a load,
//! other processes, command line options, and the files of figures for the plots.

pub mod dense;
pub mod figures;
pub mod options;
pub mod peer;
pub mod rounds;
pub mod worker;

use std::time::Duration;

use criterion::Criterion;

/// Criterion settings of all benches: short, since the ratios come from [`rounds`] and not from its samples.
pub fn criterion() -> Criterion {
    Criterion::default()
        .sample_size(50)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .configure_from_args()
}

/// Whether this is `cargo bench` and not a test run that only checks that the benches work.
pub fn is_measured() -> bool {
    std::env::args().any(|argument| argument == "--bench")
}
