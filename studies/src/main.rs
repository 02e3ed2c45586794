//! The program is the library; this only calls it.

fn main() {
    use equipoise_studies::{session::Session, subject::*};
    use std::time::Instant;
    let crowd = Subject::crowd(1, 4);
    let t = Instant::now();
    let lines = ask_all(&crowd, |s| {
        let t = Instant::now();
        let mut session = Session::new(s, s.settings());
        let id = session.identify(40);
        let held = session.hold_out(15);
        let t1 = t.elapsed().as_secs_f64();
        let mut n = 0;
        session.lift(4.0, |_| n += 1);
        let t2 = t.elapsed().as_secs_f64();
        let mut fast = Session::new(s, s.settings());
        let idf = fast.identify_by_windows(40);
        format!(
            "{s:?} {id:?} {:?} n {n} t {t1:.2} {t2:.2} now {}\n   {idf:?} {:?} {:.2}",
            held.rms_m(),
            session.now_s(),
            fast.hold_out(15).rms_m(),
            t.elapsed().as_secs_f64()
        )
    });
    for l in lines {
        println!("{l}");
    }
    println!("{:.2}", t.elapsed().as_secs_f64());
}
