//! The C compiler, and the library beside this test.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The library's folder: cargo builds it for the tests of this package, beside the tests.
fn library_folder() -> PathBuf {
    let executable = std::env::current_exe().unwrap();
    let folder = executable.parent().unwrap().to_owned();
    assert!(folder.join("libequipoise_c.so").exists(), "no library in {}", folder.display());
    folder
}

/// How a program is tied to the library.
#[derive(Debug, Clone, Copy)]
#[allow(dead_code, clippy::allow_attributes, reason = "one of the tests needs one of them only")]
pub(crate) enum Link {
    Shared,
    Static,
}

/// Compiles a C file strictly; the program lies in `scratch`.
pub(crate) fn compile(source: &Path, link: Link, scratch: &Path) -> PathBuf {
    let (program, library) = (scratch.join("program"), library_folder());
    let mut compiler = Command::new(std::env::var_os("CC").unwrap_or("cc".into()));
    compiler.args(["-std=c11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1", "-I"]);
    compiler.arg(env!("CARGO_MANIFEST_DIR")).arg(source).arg("-o").arg(&program);
    match link {
        Link::Shared => {
            compiler.arg("-L").arg(&library).arg("-lequipoise_c");
            compiler.arg(format!("-Wl,-rpath,{}", library.display()));
        }
        Link::Static => {
            compiler.arg(library.join("libequipoise_c.a"));
        }
    }
    compiler.args(["-lpthread", "-lm", "-ldl"]);
    let ended = compiler.output().expect("a C compiler: a permitted requirement of this workspace");
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stderr));
    program
}

/// What a program that must succeed says.
pub(crate) fn said(ended: &Output) -> String {
    let (out, err) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.success(), "out: {out} err: {err}");
    out.into_owned()
}
