//! Files with passwords and keys: read only if nobody else can.

use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Larger files are neither lists of passwords nor keys.
const BYTES_MAX: u64 = 64 * 1024;

/// Why such a file is not used.
#[derive(Debug, thiserror::Error)]
pub enum SecretError {
    /// It cannot be read.
    #[error("cannot read {path}: {source}; name an existing file that this user may read")]
    Read {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// Others may read or write it.
    #[error("{path} holds a secret, but others may read or change it (mode {mode:04o}): chmod 0600 {path}")]
    Open {
        /// Which file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
    },
    /// A line of it is not `name:password`.
    #[error("{path}, line {line}: {what}; a line is name:password, a name stands once, # begins a comment")]
    Line {
        /// Which file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong, without what stands there.
        what: &'static str,
    },
}

/// A name and its password, which no log ever shows.
#[derive(Clone, PartialEq, Eq)]
pub struct Login {
    /// Name.
    pub name: String,
    /// Password.
    pub password: String,
}

impl std::fmt::Debug for Login {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "Login({}, …)", self.name)
    }
}

/// A file that nobody else can read, or a private key would be none.
///
/// # Errors
/// The file cannot be read, or others may read or change it.
pub fn read(path: &Path) -> Result<String, SecretError> {
    let failed = |source| SecretError::Read { path: path.to_owned(), source };
    let facts = std::fs::metadata(path).map_err(failed)?;
    let mode = facts.mode() & 0o7777;
    if mode & 0o077 != 0 {
        return Err(SecretError::Open { path: path.to_owned(), mode });
    }
    if facts.len() > BYTES_MAX {
        return Err(failed(std::io::Error::other("larger than 64 KiB")));
    }
    std::fs::read_to_string(path).map_err(failed)
}

/// The logins of a file: `name:password`, one a line. The password is the rest of the line, colons included.
///
/// # Errors
/// The file cannot be read, is open to others, has no login, or a line that is none.
pub fn logins(path: &Path) -> Result<Vec<Login>, SecretError> {
    let text = read(path)?;
    let wrong = |line, what| SecretError::Line { path: path.to_owned(), line, what };
    let mut all: Vec<Login> = Vec::new();
    for (index, line) in text.lines().enumerate().filter(|(_, line)| !is_idle(line)) {
        let (name, password) = line.split_once(':').ok_or_else(|| wrong(index + 1, "it has no colon"))?;
        if name.is_empty() || password.is_empty() {
            return Err(wrong(index + 1, "name or password is empty"));
        }
        if all.iter().any(|login| login.name == name) {
            return Err(wrong(index + 1, "the name stands there twice"));
        }
        all.push(Login { name: name.to_owned(), password: password.to_owned() });
    }
    if all.is_empty() {
        return Err(wrong(1, "no login is there"));
    }
    Ok(all)
}

fn is_idle(line: &str) -> bool {
    line.trim().is_empty() || line.starts_with('#')
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn file(text: &str, mode: u32) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(mode)).unwrap();
        file
    }

    #[test]
    fn a_password_is_the_rest_of_its_line() {
        let found = logins(file("# who\n\nplc:a:b c \nmes:x\n", 0o600).path()).unwrap();
        assert_eq!(found.iter().map(|login| login.name.as_str()).collect::<Vec<_>>(), ["plc", "mes"]);
        assert_eq!(found[0].password, "a:b c ");
        assert!(!format!("{found:?}").contains("a:b"));
    }

    #[test]
    fn what_others_can_read_or_what_is_no_login_is_refused() {
        for mode in [0o640, 0o604, 0o620, 0o601] {
            let refusal = logins(file("plc:x\n", mode).path()).unwrap_err();
            assert!(refusal.to_string().contains("chmod 0600"), "{mode:o}: {refusal}");
        }
        for text in ["", "# nobody\n", "plc\n", "plc:\n", ":x\n", "plc:x\nplc:y\n"] {
            let refusal = logins(file(text, 0o600).path()).unwrap_err();
            assert!(matches!(refusal, SecretError::Line { .. }), "{text:?}: {refusal}");
        }
        assert!(matches!(logins(Path::new("no/such/file")), Err(SecretError::Read { .. })));
    }
}
