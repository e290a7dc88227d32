//! `praxi`, the command line tool.

fn main() -> std::process::ExitCode {
    host::commands::main()
}
