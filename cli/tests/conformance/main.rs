//! The same checks for every adapter, through its real transport, with the simulator's device at the other end and the
//! configuration section that a user would write.
//!
//! The results are a table; `docs/sensors/README.md` contains a copy, which must be current (`EQUIPOISE_WRITE=1`
//! rewrites it).
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod cases;
mod disturbance;
mod host;
mod person;
mod questions;
mod rig;
mod simulate;
mod table;

use std::sync::Arc;

use cases::CASES;
use person::Person;
use table::Row;

#[test]
fn every_adapter_answers_every_question() {
    let person = Arc::new(Person::new());
    let only = std::env::var("EQUIPOISE_ADAPTER").ok();
    let spawned: Vec<_> = CASES
        .iter()
        .filter(|case| only.as_ref().is_none_or(|only| case.name.contains(only.as_str())))
        .collect();
    let threads: Vec<_> = spawned
        .iter()
        .map(|case| {
            let (case, person) = (**case, Arc::clone(&person));
            std::thread::spawn(move || disturbance::retry(|| questions::ask(&case, &person)))
        })
        .collect();
    let (mut rows, mut inconclusive) = (Vec::new(), Vec::new());
    for (case, threads) in spawned.iter().zip(threads) {
        let (answers, disturbed) = threads.join().unwrap_or_else(|_| (Err("panicked".into()), None));
        let row = Row { case, answers };
        match disturbed {
            Some(late) if !table::wrong(std::slice::from_ref(&row)).is_empty() => {
                inconclusive.push((row, late));
            }
            _ => rows.push(row),
        }
    }
    let table = table::written(&rows);
    println!("{table}");
    for (row, late) in &inconclusive {
        println!(
            "inconclusive, since a byte took {late:?} through a pseudo terminal: {}",
            table::wrong(std::slice::from_ref(row)).join("; ")
        );
    }
    let wrong = table::wrong(&rows);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    if only.is_none() && inconclusive.is_empty() {
        table::compare_with_the_documents(&table);
    }
}
