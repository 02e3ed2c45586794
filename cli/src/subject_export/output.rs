//! Folder or archive that receives the files; complete or absent.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use equipoise_files::atomic_file::MODE;

use super::archive;

/// A folder or a `.tar` archive being written under a temporary name.
pub(super) struct Output {
    temporary: PathBuf,
    out: PathBuf,
    /// `None` for a folder.
    archive: Option<BufWriter<File>>,
}

impl Output {
    /// Begins a `.tar` file if the name ends so, otherwise a folder.
    ///
    /// # Errors
    /// The file or folder exists already, or cannot be created.
    pub(super) fn create(out: &Path) -> anyhow::Result<Output> {
        // Without a slash at the end of a folder's name.
        let out = out.components().as_path();
        let is_empty = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_none());
        if out.exists() && !is_empty {
            bail!("--out {} exists already; choose another name", out.display());
        }
        let mut name: OsString = out.as_os_str().to_owned();
        name.push(format!(".{}.part", std::process::id()));
        let temporary = PathBuf::from(name);
        let unwritten = || format!("cannot write {}", temporary.display());
        let is_archive = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("tar"));
        let archive = if is_archive {
            Some(BufWriter::new(new_file(&temporary).with_context(unwritten)?))
        } else {
            fs::create_dir(&temporary).with_context(unwritten)?;
            None
        };
        Ok(Output { temporary, out: out.to_owned(), archive })
    }

    /// Adds a file with `length` bytes of `content`; `name` is relative.
    ///
    /// # Errors
    /// The content is shorter, or the output cannot be written.
    pub(super) fn add(&mut self, name: &Path, content: &mut dyn Read, length: u64) -> io::Result<()> {
        let mut content = content.take(length);
        if let Some(archive) = &mut self.archive {
            archive::append(archive, &name.to_string_lossy(), length, &mut content)?;
        } else {
            let path = self.temporary.join(name);
            fs::create_dir_all(path.parent().unwrap_or(&self.temporary))?;
            io::copy(&mut content, &mut new_file(&path)?)?;
        }
        if content.limit() > 0 {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "it became shorter while it was read"));
        }
        Ok(())
    }

    /// Completes the output under its name.
    ///
    /// # Errors
    /// It cannot be written.
    pub(super) fn finish(mut self) -> anyhow::Result<()> {
        let unwritten = format!("cannot write {}", self.out.display());
        if let Some(archive) = &mut self.archive {
            archive::finish(archive).with_context(|| unwritten.clone())?;
        }
        fs::rename(&self.temporary, &self.out).context(unwritten)
    }
}

impl Drop for Output {
    fn drop(&mut self) {
        // Removes an incomplete output. After the rename this name no longer exists.
        let _ = fs::remove_file(&self.temporary);
        let _ = fs::remove_dir_all(&self.temporary);
    }
}

fn new_file(path: &Path) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).mode(MODE).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_and_an_archive_have_the_same_files() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["out", "out.tar"] {
            let out = folder.path().join(name);
            let mut output = Output::create(&out).unwrap();
            output.add(Path::new("a/one.txt"), &mut &b"one and more"[..], 3).unwrap();
            output.finish().unwrap();
            assert!(Output::create(&out).is_err(), "exists");
        }
        assert_eq!(fs::read(folder.path().join("out/a/one.txt")).unwrap(), b"one");
        let archive = fs::read(folder.path().join("out.tar")).unwrap();
        assert!(archive.starts_with(b"a/one.txt\0") && &archive[512..516] == b"one\0");
    }

    #[test]
    fn an_interrupted_export_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["out", "out.tar"] {
            let mut output = Output::create(&folder.path().join(name)).unwrap();
            let short = output.add(Path::new("one.txt"), &mut &b"on"[..], 3);
            assert!(short.is_err());
            drop(output);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
