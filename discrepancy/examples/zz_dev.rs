#[path = "../tests/support/mod.rs"]
mod support;
use equipoise_core::effect::*;
use equipoise_core::body::*;
use equipoise_discrepancy::{Options, reconcile};
fn main() {
    for seed in 1..8u64 {
        let mut s = support::clean(seed);
        if seed > 4 { support::hide(&mut s, Effect::HandLoad, Place::Hand(Side::Left), &[0.5], [200.0, 300.0]); }
        let t = std::time::Instant::now();
        let mut last = std::time::Instant::now();
        let o = reconcile(&s, &Options::default(), &mut |p| { eprint!(" {p:.1}:{:.2}s", last.elapsed().as_secs_f64()); last = std::time::Instant::now(); }).unwrap();
        eprintln!();
        println!("{seed} blocks {} {:.2} s thr {:.2} {:?} {:?}", s.blocks.len(), t.elapsed().as_secs_f64(), o.picture.threshold_log_odds, o.finding.verdict, o.finding.effects.iter().map(|e| (e.name.clone(), e.place.clone(), e.log_odds)).collect::<Vec<_>>());
        println!("   {:?}", o.finding.candidates.iter().take(4).map(|c| format!("{} {:.1}", c.name, c.log_odds)).collect::<Vec<_>>());
    }
}
