//! Files with tokens, passwords and keys: read only if other users cannot access them.

use std::io::{Error, ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use crate::{Links, open_regular_by};

/// Lists of passwords and keys are smaller.
const BYTES_MAX: u64 = 64 * 1024;

/// Why a file with a secret is rejected.
#[derive(Debug, thiserror::Error)]
pub enum SecretError {
    /// The file cannot be read.
    #[error("cannot read {path}: {source}; name an existing file that this user may read")]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: Error,
    },
    /// The path is a symbolic link, a directory, a pipe or a device.
    #[error("{path} holds a secret, but {what}: name the regular file itself")]
    Kind {
        /// Path of the file.
        path: PathBuf,
        /// Kind of the file.
        what: String,
    },
    /// The file belongs to another user, who can change it.
    #[error(
        "{path} holds a secret, but belongs to user {owner}: chown it to {user}, the user of this process, or to root"
    )]
    Owner {
        /// Path of the file.
        path: PathBuf,
        /// User id of its owner.
        owner: u32,
        /// User id of this process.
        user: u32,
    },
    /// Other users may read or write the file.
    #[error(
        "{path} holds a secret, but others may read or change it (mode {mode:04o}): chmod {mode_max:04o} {path}"
    )]
    Open {
        /// Path of the file.
        path: PathBuf,
        /// Its permissions.
        mode: u32,
        /// The maximum permissions.
        mode_max: u32,
    },
    /// A line is not `name:password`.
    #[error("{path}, line {line}: {what}; a line is name:password, a name stands once, # begins a comment")]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// What is wrong, without the content of the line.
        what: &'static str,
    },
}

/// A name and its password, which `Debug` omits.
#[derive(Clone, PartialEq, Eq)]
pub struct Login {
    /// User name.
    pub name: String,
    /// Password.
    pub password: String,
}

impl std::fmt::Debug for Login {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(to, "Login({}, …)", self.name)
    }
}

/// Users besides root that may be able to read a secret.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readers {
    /// The owner.
    Owner,
    /// The owner and the members of its group.
    Group,
}

impl Readers {
    fn mode_max(self) -> u32 {
        match self {
            Readers::Owner => 0o600,
            Readers::Group => 0o640,
        }
    }
}

/// The text of a file that only its owner can read, for example a private key.
///
/// # Errors
/// The file cannot be read, is no regular file, belongs to another user, or others may read or change it.
pub fn read(path: &Path) -> Result<String, SecretError> {
    read_for(path, Readers::Owner)
}

/// The text of a file that `readers` can read.
///
/// # Errors
/// As [`read`].
pub fn read_for(path: &Path, readers: Readers) -> Result<String, SecretError> {
    let failed = |source| SecretError::Read { path: path.to_owned(), source };
    let (file, facts) = open_regular_by(path, Links::Refuse).map_err(|error| match error.kind() {
        ErrorKind::InvalidInput => SecretError::Kind { path: path.to_owned(), what: error.to_string() },
        _ => failed(error),
    })?;
    check(path, facts.uid(), facts.mode() & 0o7777, rustix::process::geteuid().as_raw(), readers)?;
    let mut text = String::new();
    match file.take(BYTES_MAX + 1).read_to_string(&mut text) {
        Ok(length) if length as u64 > BYTES_MAX => {
            Err(failed(Error::new(ErrorKind::FileTooLarge, "larger than 64 KiB")))
        }
        Ok(_) => Ok(text),
        Err(error) => Err(failed(error)),
    }
}

/// The group whose members can read a file; `None` if its mode excludes the group.
///
/// # Errors
/// The system's error, or the file is not regular.
pub fn group_of_readers(path: &Path) -> std::io::Result<Option<u32>> {
    let (_, facts) = open_regular_by(path, Links::Refuse)?;
    Ok((facts.mode() & 0o040 != 0).then_some(facts.gid()))
}

/// Checks that only `user`, root and `readers` can read or change a file of this owner and mode.
fn check(path: &Path, owner: u32, mode: u32, user: u32, readers: Readers) -> Result<(), SecretError> {
    let (path, mode_max) = (path.to_owned(), readers.mode_max());
    if mode & !mode_max != 0 {
        return Err(SecretError::Open { path, mode, mode_max });
    }
    // Last: `equipoise check` as root passes over this error only.
    if owner != user && owner != 0 {
        return Err(SecretError::Owner { path, owner, user });
    }
    Ok(())
}

/// The logins of a file, one `name:password` per line. The password is the rest of the line, colons included.
///
/// # Errors
/// The file cannot be read, is accessible to other users, has no login, or has an invalid line.
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
    fn only_a_regular_file_of_this_user_or_root_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("a"), folder.path().join("link"));
        std::fs::write(&real, "secret").unwrap();
        std::fs::set_permissions(&real, std::fs::Permissions::from_mode(0o640)).unwrap();
        assert_eq!(read_for(&real, Readers::Group).unwrap(), "secret");
        let group = std::fs::metadata(&real).unwrap().gid();
        assert_eq!(group_of_readers(&real).unwrap(), Some(group));
        assert_eq!(group_of_readers(file("secret", 0o600).path()).unwrap(), None);
        assert!(read(&real).unwrap_err().to_string().contains("chmod 0600"));
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let refusal = read(&link).unwrap_err().to_string();
        assert!(refusal.contains("is a symbolic link: name the regular file"), "{refusal}");
        assert!(matches!(read(folder.path()), Err(SecretError::Kind { .. })));
        let owned = |owner| check(&real, owner, 0o640, 1000, Readers::Group);
        assert!(owned(1000).is_ok() && owned(0).is_ok());
        let refusal = owned(1001).unwrap_err().to_string();
        assert!(
            refusal.contains("belongs to user 1001") && refusal.contains("chown it to 1000"),
            "{refusal}"
        );
        std::fs::write(&real, vec![b'a'; BYTES_MAX as usize + 1]).unwrap();
        assert!(read_for(&real, Readers::Group).unwrap_err().to_string().contains("larger than 64 KiB"));
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
