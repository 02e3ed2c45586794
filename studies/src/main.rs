//! The program is the library; this only hands over its exit code.

fn main() -> std::process::ExitCode {
    equipoise_studies::cli::main()
}
