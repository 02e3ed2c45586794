//! The page with a simulated human: takes poses for identification for a while, then lifts a box, in an endless loop.
//!
//! ```sh
//! cargo run -p equipoise-view --example page             # the whole story
//! cargo run -p equipoise-view --example page -- red      # one scene: learning, hold, light, red, heavy, silent-suit, silent
//! ```

use std::error::Error;
use std::time::{Duration, Instant};

use bytemuck::Zeroable;
use equipoise_core::body::Skeleton;
use equipoise_core::body::{Joint, SEGMENTS, Segment};
use equipoise_core::message::state::Phase;
use equipoise_core::message::{State, Validity};
use equipoise_core::pose_suggestion::{Posture, posture::pose_of};
use equipoise_view::suggested_pose::SuggestedPose;
use equipoise_view::{Page, PageFrame, terminal};

fn main() -> Result<(), Box<dyn Error>> {
    let scene = std::env::args().nth(1);
    let started = Instant::now();
    let page = Page::start("127.0.0.1:8017".parse()?, {
        let scene = scene.clone();
        let says_something = scene.as_deref() != Some("silent");
        move || says_something.then(|| frame(scene.as_deref(), started.elapsed().as_secs_f64()))
    })?;
    println!("look at {}", page.url());
    loop {
        std::thread::sleep(Duration::from_secs(1));
        let frame = frame(scene.as_deref(), started.elapsed().as_secs_f64());
        println!("{}", terminal::live_line(&frame.state, frame.suggested.as_ref().map(|pose| &*pose.name)));
    }
}

/// The frame at time `t`, s.
fn frame(scene: Option<&str>, t: f64) -> PageFrame {
    let t_in_story = t % 40.0;
    let mut frame = match scene.unwrap_or(if t_in_story < 20.0 { "learning" } else { "red" }) {
        "learning" => learning(t_in_story),
        "hold" => holding(),
        "light" => carrying(t, 3.0),
        "heavy" => carrying(t, 55.0),
        "silent-suit" => {
            let mut frame = carrying(t, 12.0);
            frame.state.phase = Phase::Degraded as u32;
            frame.state.valid = Validity::SUIT_STALE.and(Validity::MOVING).0;
            frame
        }
        _ => carrying(t, 12.0),
    };
    frame.state.cycle = (t * 1000.0) as u64 + 1;
    frame.state.time_ns = (t * 1e9) as u64 + 1;
    frame.plate_corners_m = Some([[0.38, 0.30], [0.38, -0.30], [-0.18, -0.30], [-0.18, 0.30]]);
    frame.cop_sigma_target_m = Some(0.010);
    frame
}

fn learning(t: f64) -> PageFrame {
    let sway = (0.8 * t).sin();
    let mut state = standing(&posture("", [0, (10.0 * sway) as i16, 0], 60 + (20.0 * sway) as i16, 25));
    state.phase = Phase::Identifying as u32;
    state.valid = Validity::NOT_IDENTIFIED.and(Validity::BELOW_LOAD_THRESHOLD).0;
    state.poses_used = 4;
    state.predicted_cop_sigma_m = 0.023;
    state.cop_sigma_m = [0.021, 0.016];
    state.suggested_pose = 3;
    state.pose_mismatch_rad = 0.6;
    let target = posture("lean forward, arms out", [0, 25, 0], 5, 0);
    let suggested = SuggestedPose::on_the_spot(&target, &state.segment_origin_m);
    PageFrame { suggested: Some(suggested), ..PageFrame::new(state) }
}

/// Holds the suggested pose, static.
fn holding() -> PageFrame {
    let mut frame = learning(0.0);
    frame.state.segment_origin_m =
        frame.suggested.as_ref().map_or(frame.state.segment_origin_m, |pose| pose.segment_origin_m);
    frame.state.pose_mismatch_rad = 0.1;
    frame.state.static_pose = 1;
    frame
}

fn carrying(t: f64, load_kg: f64) -> PageFrame {
    let bend = 22.0 + 8.0 * (0.7 * t).sin();
    let mut state = standing(&posture("", [0, bend as i16, 0], 55, 55));
    state.phase = Phase::Monitoring as u32;
    state.converged = 1;
    state.poses_used = 9;
    state.predicted_cop_sigma_m = 0.009;
    state.cop_measured_m = [0.14, 0.03];
    state.delta_f_n = [0.0, 0.0, 9.81 * load_kg];
    let hands = state.segment_origin_m[Segment::RightHand.index()][0];
    for joint in Joint::ALL {
        let index = joint.index();
        let arm_m = hands - state.segment_origin_m[joint.segment().index()][0];
        let factor = if joint == Joint::ALL[0] { 1.0 } else { 0.5 };
        let torque = factor * 9.81 * load_kg * arm_m;
        state.torque_nm[index] = [0.0, torque, 0.3];
        state.torque_sigma_nm[index] = 0.6 + 0.05 * torque.abs();
        state.joint_level[index] =
            1 + [12.0, 20.0, 42.0].iter().filter(|step| torque.abs() > **step).count() as u32;
    }
    for foot in ["LeftBallFoot", "RightBallFoot"].into_iter().filter_map(Joint::named) {
        state.joint_level[foot.index()] = 0;
    }
    PageFrame::new(state)
}

const ANKLE_HEIGHT_M: f64 = 0.095;

fn body() -> Skeleton {
    Skeleton::nominal(1.77)
}

/// A state of a person in this posture.
fn standing(posture: &Posture) -> State {
    let origin = pose_of(posture, &body(), [0.0; 3]).origin;
    let ankle = origin[Segment::LeftFoot.index()];
    let mut state = State::zeroed();
    state.segment_origin_m =
        origin.map(|point| [point.x - ankle.x, point.y, point.z - ankle.z + ANKLE_HEIGHT_M]);
    state.suit_sample_time_ns = 1;
    state.suit_age_ns = 6_000_000;
    state.mass_kg = 72.0;
    state.cop_measured_m = [0.075, 0.012];
    state.cop_estimated_m = [0.06, -0.004];
    state.cop_sigma_m = [0.009, 0.006];
    state.suggested_pose = u32::MAX;
    state
}

/// Leans by `lean_deg` from the hips, with arms down by `arm_deg` and forearms flexed.
fn posture(name: &'static str, lean_deg: [i16; 3], arm_deg: i16, elbow_deg: i16) -> Posture {
    let mut rotation_deg = [[0; 3]; SEGMENTS];
    rotation_deg[Segment::L5.index()] = lean_deg;
    rotation_deg[Segment::RightUpperArm.index()] = [arm_deg, 0, 0];
    rotation_deg[Segment::LeftUpperArm.index()] = [-arm_deg, 0, 0];
    rotation_deg[Segment::RightForearm.index()] = [0, 0, elbow_deg];
    rotation_deg[Segment::LeftForearm.index()] = [0, 0, -elbow_deg];
    rotation_deg[Segment::RightUpperLeg.index()] = [-6, -8, 0];
    rotation_deg[Segment::LeftUpperLeg.index()] = [6, -8, 0];
    rotation_deg[Segment::RightLowerLeg.index()] = [0, 14, 0];
    rotation_deg[Segment::LeftLowerLeg.index()] = [0, 14, 0];
    rotation_deg[Segment::RightFoot.index()] = [6, -6, 0];
    rotation_deg[Segment::LeftFoot.index()] = [-6, -6, 0];
    Posture { name, rotation_deg }
}
