use equipoise_core::body::*;
use equipoise_core::cycle::*;
use equipoise_core::message::Validity;
use equipoise_studies::{session::Session, subject::*};
const NAMES: [&str; 7] = ["L5S1", "LeftHip", "RightKnee", "LeftAnkle", "RightShoulder", "LeftElbow", "T9T8"];
fn main() {
    let crowd = Subject::crowd(1, 4);
    for (name, motion) in [
        ("paper", Motion::Paper),
        (
            "comp",
            Motion::Compensated {
                half_window_ns: std::env::var("HALF")
                    .map_or(67_000_000, |v| v.parse::<u64>().unwrap() * 1_000_000),
            },
        ),
    ] {
        let lines = ask_all(&crowd, |s| {
            let mut settings = s.settings();
            settings.motion = motion;
            let mut session = Session::new(s, settings);
            let id = session.identify(40);
            let mut out = format!("{name} {id:?}\n");
            for (what, kg) in [("unloaded", 0.0), ("lift8", 8.0)] {
                let (mut n, mut e2, mut f2, mut z, mut sz, mut zc, mut valid, mut tq) =
                    (0.0, [0.0; 2], 0.0, 0.0, 0.0, 0.0, 0.0, [[0.0; 4]; 7]);
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
                    let df = st.delta_f_n[2] - load * (1.0 + 0.0);
                    f2 += df * df;
                    z += st.delta_f_sigma_n;
                    sz += (df / st.delta_f_sigma_n).powi(2);
                    if !st.validity().any_of(Validity::SPOILS_TORQUES) {
                        valid += 1.0;
                        for (k, name) in NAMES.iter().enumerate() {
                            let j = Joint::named(name).unwrap().index();
                            let e = nalgebra::Vector3::from(st.torque_nm[j]) - tr.overload_in_motion_nm[j];
                            let e1 = nalgebra::Vector3::from(st.torque_nm[j]).norm()
                                - tr.overload_in_motion_nm[j].norm();
                            let z = e1 / st.torque_sigma_nm[j];
                            tq[k][0] += e.norm_squared();
                            tq[k][1] += z * z;
                            tq[k][2] += f64::from(u8::from(z.abs() < 1.0));
                            tq[k][3] += f64::from(u8::from(z.abs() < 2.0));
                        }
                    }
                };
                if kg == 0.0 {
                    session.work_unloaded(&mut look);
                } else {
                    session.lift_at_work(kg, &mut look);
                }
                out += &format!(
                    "  {what}: n {n} cop rms mm {:.2} {:.2} z2 {:.2} dF rms {:.2} sig {:.2} z2 {:.2} valid {:.3}\n",
                    1e3 * f64::sqrt(e2[0] / n),
                    1e3 * f64::sqrt(e2[1] / n),
                    zc / n,
                    f64::sqrt(f2 / n),
                    z / n,
                    sz / n,
                    valid / n,
                );
                let v = f64::max(valid, 1.0);
                for (k, name) in NAMES.iter().enumerate() {
                    out += &format!(
                        "      {name} rms {:.2} z2 {:.2} in1 {:.2} in2 {:.2}\n",
                        f64::sqrt(tq[k][0] / v),
                        tq[k][1] / v,
                        tq[k][2] / v,
                        tq[k][3] / v
                    );
                }
            }
            out
        });
        for l in lines {
            println!("{l}");
        }
    }
}
