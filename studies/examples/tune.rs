use equipoise_core::body::*;
use equipoise_core::cycle::*;
use equipoise_core::message::Validity;
use equipoise_studies::{session::Session, subject::*};
fn main() {
    let crowd = Subject::crowd(1, 4);
    for (name, motion) in
        [("paper", Motion::Paper), ("comp", Motion::Compensated { half_window_ns: 100_000_000 })]
    {
        let lines = ask_all(&crowd, |s| {
            let mut settings = s.settings();
            settings.motion = motion;
            let mut session = Session::new(s, settings);
            let id = session.identify(40);
            let mut out = format!("{name} {id:?}\n");
            for (what, kg) in [("unloaded", 0.0), ("lift8", 8.0)] {
                let (mut n, mut e2, mut f2, mut z, mut sz, mut zc, mut valid, mut tq) =
                    (0.0, [0.0; 2], 0.0, 0.0, 0.0, 0.0, 0.0, [0.0; 2]);
                let mut look = |m: &equipoise_studies::session::Moment| {
                    let (st, tr) = (m.state, m.truth());
                    n += 1.0;
                    for a in 0..2 {
                        let e = if kg == 0.0 { st.cop_measured_m[a] - st.cop_estimated_m[a] } else { 0.0 };
                        e2[a] += e * e;
                        let c = e / st.cop_sigma_m[a].max(1e-9);
                        zc += 0.5 * c * c;
                    }
                    let load = tr.body.load_kg * 9.81;
                    let df = st.delta_f_n[2] - load;
                    f2 += df * df;
                    z += st.delta_f_sigma_n;
                    sz += (df / st.delta_f_sigma_n).powi(2);
                    if !st.validity().any_of(Validity::SPOILS_TORQUES) {
                        valid += 1.0;
                        let j = Joint::named("L5S1").unwrap().index();
                        let e = nalgebra::Vector3::from(st.torque_nm[j]) - tr.overload_at_cop_nm[j];
                        tq[0] += e.norm_squared();
                        tq[1] += (e.norm() / st.torque_sigma_nm[j]).powi(2);
                    }
                };
                if kg == 0.0 {
                    session.work_unloaded(&mut look);
                } else {
                    session.lift_at_work(kg, &mut look);
                }
                out += &format!(
                    "  {what}: n {n} cop rms mm {:.2} {:.2} z2 {:.2} dF rms {:.2} sig {:.2} z2 {:.2} valid {:.3} L5S1 rms {:.2} z2 {:.2}\n",
                    1e3 * f64::sqrt(e2[0] / n),
                    1e3 * f64::sqrt(e2[1] / n),
                    zc / n,
                    f64::sqrt(f2 / n),
                    z / n,
                    sz / n,
                    valid / n,
                    f64::sqrt(tq[0] / f64::max(valid, 1.0)),
                    tq[1] / f64::max(valid, 1.0)
                );
            }
            out
        });
        for l in lines {
            println!("{l}");
        }
    }
}
