//! From a recording to a session of blocks: right about what was predicted and measured, and clear about what it
//! lacks.
#![expect(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod accuracy;
mod make;
#[test]
fn tmp_make() {
    make::Script { poses: 14, work_s: 560.0, ..make::Script::ordinary() }
        .record(std::path::Path::new("/tmp"), "tm.mcap");
}
