//! The C compiler, and the library that cargo builds for these tests.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Folder of the library: cargo places it next to the test binaries of this package.
fn library_folder() -> PathBuf {
    let executable = std::env::current_exe().unwrap();
    let folder = executable.parent().unwrap().to_owned();
    assert!(folder.join("libequipoise_c.so").exists(), "no library in {}", folder.display());
    folder
}

/// How a program is linked with the library.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Link {
    Shared,
    Static,
}

/// The compiler for a file extension, and its language standard option.
fn of(ending: &str) -> (Command, &'static str) {
    let (variable, usual, standard) = match ending {
        "cpp" => ("CXX", "c++", "-std=c++17"),
        _ => ("CC", "cc", "-std=c11"),
    };
    (Command::new(std::env::var_os(variable).unwrap_or(usual.into())), standard)
}

/// Whether the compiler for this file extension exists.
pub(crate) fn is_installed(ending: &str) -> bool {
    of(ending).0.arg("--version").output().is_ok_and(|ended| ended.status.success())
}

/// Compiles a C file, or a C++ file if its extension is `cpp`, with strict warnings; the program is placed in
/// `scratch`.
pub(crate) fn compile(source: &Path, link: Link, scratch: &Path) -> PathBuf {
    let (program, library) = (scratch.join("program"), library_folder());
    let (mut compiler, standard) = of(source.extension().and_then(OsStr::to_str).unwrap());
    compiler.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O1"]);
    for headers in [env!("CARGO_MANIFEST_DIR"), concat!(env!("CARGO_MANIFEST_DIR"), "/../cpp")] {
        compiler.arg("-I").arg(headers);
    }
    compiler.arg(source).arg("-o").arg(&program);
    match link {
        Link::Shared => {
            compiler.arg("-L").arg(&library).arg("-lequipoise_c");
            // Takes precedence over LD_LIBRARY_PATH, in which cargo may name a folder with an earlier build.
            compiler.arg(format!("-Wl,--disable-new-dtags,-rpath,{}", library.display()));
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

/// Standard output of a program that must succeed.
pub(crate) fn stdout_of(ended: &Output) -> String {
    let (out, err) = (String::from_utf8_lossy(&ended.stdout), String::from_utf8_lossy(&ended.stderr));
    assert!(ended.status.success(), "out: {out} err: {err}");
    out.into_owned()
}
