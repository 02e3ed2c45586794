//! The same checks for every adapter, through its real transport, with the simulator's device at the other end and the
//! configuration section that a user would write.
//!
//! The results are a table; `docs/sensors/README.md` contains a copy, which must be current (`EQUIPOISE_WRITE=1`
//! rewrites it).
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, in its helpers too")]

mod cases;
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
    let asked: Vec<_> = CASES
        .iter()
        .filter(|case| only.as_ref().is_none_or(|only| case.name.contains(only.as_str())))
        .collect();
    let asking: Vec<_> = asked
        .iter()
        .map(|case| {
            let (case, person) = (**case, Arc::clone(&person));
            std::thread::spawn(move || questions::ask(&case, &person))
        })
        .collect();
    let rows: Vec<Row> = asked
        .iter()
        .zip(asking)
        .map(|(case, asking)| Row { case, answers: asking.join().unwrap_or_else(|_| Err("panicked".into())) })
        .collect();
    let table = table::written(&rows);
    println!("{table}");
    let wrong = table::wrong(&rows);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    if only.is_none() {
        table::compare_with_the_documents(&table);
    }
}
