//! The program is in the library; this only returns its exit code.

fn main() -> std::process::ExitCode {
    equipoise_studies::cli::main()
}
