//! Writes the pose library of `equipoise_core` from the simulator's repertoire, for an average person:
//! `cargo run -p equipoise-simulator --example pose_library > core/src/pose_suggestion/library.rs`

use equipoise_core::body::SEGMENTS;
use equipoise_simulator::balance::Standing;
use equipoise_simulator::kinematics::relative_to_parents;
use equipoise_simulator::limits;
use equipoise_simulator::person::Person;
use equipoise_simulator::repertoire::REPERTOIRE;
use equipoise_simulator::stance::Stance;

const HEAD: &str = "\
//! Poses that people can hold: feasible for the joints, in balance over flat feet, and different from each other.
//!
//! Generated, for an average person of 1.75 m, by
//! `cargo run -p equipoise-simulator --example pose_library > core/src/pose_suggestion/library.rs`.

use super::Posture;

/// The library. The first pose is the one to start from; `State::suggested_pose` is an index into it.
#[rustfmt::skip]
pub const LIBRARY: &[Posture] = &[";

fn main() {
    let person = Person::nominal(1.75, 72.0);
    let stance = Stance::shoulder_wide(&person);
    let standing = Standing { person: &person, com_m: &person.com_m, stance: &stance, load_kg: 0.0 };
    let target = stance.between_the_feet_m(0.025 * person.height_m);
    println!("{HEAD}");
    for (name, intention) in REPERTOIRE {
        let body = standing.balance(&intention.pose(), target);
        if let Err(strain) = limits::check(&body) {
            eprintln!("left out, {strain:?}: {name}");
            continue;
        }
        let degrees = relative_to_parents(&body.world_from_segment).map(|rotation| {
            let turn = rotation.scaled_axis();
            [turn.x, turn.y, turn.z].map(|angle| angle.to_degrees().round() as i16)
        });
        print_posture(name, &degrees);
    }
    println!("];");
}

/// Trunk with head, arms, legs: a line each.
fn print_posture(name: &str, degrees: &[[i16; 3]; SEGMENTS]) {
    println!("    Posture {{ name: \"{name}\", rotation_deg: [");
    for row in [&degrees[..7], &degrees[7..15], &degrees[15..]] {
        let cells: Vec<String> = row.iter().map(|[x, y, z]| format!("[{x}, {y}, {z}]")).collect();
        println!("        {},", cells.join(", "));
    }
    println!("    ] }},");
}
