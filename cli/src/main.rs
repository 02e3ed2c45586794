//! Calls the library and returns its exit code.

fn main() -> std::process::ExitCode {
    equipoise_cli::commands::main()
}
