//! Signatures of recordings in the format of `minisign`, each in a file next to its recording: `NAME.mcap.minisig`.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use anyhow::{Context, anyhow, ensure};
use equipoise_files::atomic_file::write_atomically;
use equipoise_files::{Sha256, open_regular, secret};
use minisign::{KeyPair, SecretKey, SecretKeyBox};
use tracing::{info, warn};

/// What the name of a signature adds to that of its recording.
pub const SIGNATURE_ENDING: &str = ".minisig";
/// What the name of a public key adds to that of its secret key.
const PUBLIC_ENDING: &str = ".pub";

/// The file with the signature of a recording.
pub fn signature_of(recording: &Path) -> PathBuf {
    with_ending(recording, SIGNATURE_ENDING)
}

/// The file in which `equipoise record --new-key` puts the public key.
pub fn public_key_of(secret_key: &Path) -> PathBuf {
    with_ending(secret_key, PUBLIC_ENDING)
}

fn with_ending(path: &Path, ending: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(ending);
    PathBuf::from(name)
}

/// The identifier of a key, as `minisign` prints it.
pub(super) fn key_id(number: &[u8]) -> String {
    number.iter().rev().map(|byte| format!("{byte:02X}")).collect()
}

/// Makes a key without a password in a new file that only its owner can read, and its public key next to it; returns the
/// path of the latter.
///
/// # Errors
/// One of the files exists or cannot be written.
pub fn make_key(path: &Path) -> anyhow::Result<PathBuf> {
    let pair = KeyPair::generate_unencrypted_keypair().context("the system has no random numbers")?;
    let public = public_key_of(path);
    write_new(path, 0o600, pair.sk.to_box(Some("secret key for Equipoise recordings"))?.into_string())?;
    write_new(&public, 0o644, pair.pk.to_box()?.into_string())?;
    Ok(public)
}

fn write_new(path: &Path, mode: u32, text: String) -> anyhow::Result<()> {
    let file = OpenOptions::new().write(true).create_new(true).mode(mode).open(path);
    file.and_then(|mut file| file.write_all(text.as_bytes())).with_context(|| {
        format!("cannot create {}; choose a new name in a writable directory", path.display())
    })
}

/// A secret key. It has no text form.
pub struct SigningKey(SecretKey);

impl SigningKey {
    /// Reads a key without a password from a file that only its owner can read.
    ///
    /// # Errors
    /// The file is missing, is accessible to other users, or holds no such key.
    pub fn read(path: &Path) -> anyhow::Result<SigningKey> {
        let text = secret::read(path)?;
        let key = SecretKeyBox::from(text).into_unencrypted_secret_key().map_err(|error| {
            anyhow!(
                "{} holds no secret key of minisign without a password ({error}); `equipoise record --new-key FILE` or \
                 `minisign -G -W` makes one",
                path.display()
            )
        })?;
        Ok(SigningKey(key))
    }

    /// Signs a finished recording whose bytes had this SHA-256 when they were written.
    ///
    /// # Errors
    /// The recording cannot be read or has changed since, or the signature cannot be written.
    pub fn sign(&self, recording: &Path, sha256: &str) -> anyhow::Result<()> {
        let name = recording.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        ensure!(
            !name.is_empty() && !name.contains(char::is_control),
            "the name of {} is not plain text; rename it to sign it",
            recording.display()
        );
        let file = open_regular(recording).with_context(|| format!("cannot read {}", recording.display()))?;
        let mut bytes = Hashed { file, hash: Sha256::default() };
        // The form of minisign's own trusted comments.
        let comment = format!("timestamp:{}\tfile:{name}\thashed", super::unix_ns() / 1_000_000_000);
        let signature =
            minisign::sign(None, &self.0, &mut bytes, Some(&comment), Some("Equipoise recording"))
                .with_context(|| format!("cannot sign {}", recording.display()))?;
        ensure!(
            bytes.hash.finish() == sha256,
            "{} has changed since it was written: it is not signed",
            recording.display()
        );
        let out = signature_of(recording);
        write_atomically(&out, signature.into_string().as_bytes())
            .with_context(|| format!("cannot write {}", out.display()))?;
        if recording.symlink_metadata().is_err() {
            // The recording was removed in the meantime.
            let _ = fs::remove_file(&out);
        }
        Ok(())
    }
}

/// Computes the SHA-256 of what `minisign` reads.
struct Hashed {
    file: File,
    hash: Sha256,
}

impl Read for Hashed {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.file.read(buffer)?;
        self.hash.update(&buffer[..count]);
        Ok(count)
    }
}

/// Waits for the disk and signs finished recordings in threads of its own, one at a time, while the next one is being
/// written.
pub(super) struct Finisher {
    key: Option<Arc<SigningKey>>,
    running: Option<JoinHandle<anyhow::Result<()>>>,
}

impl Finisher {
    /// Without a key nothing is signed.
    pub(super) fn new(key: Option<SigningKey>) -> Finisher {
        Finisher { key: key.map(Arc::new), running: None }
    }

    /// Starts to finish a recording, after the one before; `synchronise` waits until it is on the disk.
    ///
    /// # Errors
    /// An earlier one could not be written.
    pub(super) fn start(
        &mut self,
        recording: &Path,
        sha256: &str,
        synchronise: impl FnOnce() -> anyhow::Result<()> + Send + 'static,
    ) -> anyhow::Result<()> {
        self.running.take_if(|thread| thread.is_finished()).map_or(Ok(()), join)?;
        let (before, key) = (self.running.take(), self.key.clone());
        let (recording, sha256) = (recording.to_owned(), sha256.to_owned());
        let finish = move || {
            let before = before.map_or(Ok(()), join);
            synchronise()?;
            match key.map(|key| key.sign(&recording, &sha256)) {
                None => {}
                Some(Ok(())) => info!("{} is signed", recording.display()),
                Some(Err(error)) => warn!("{} stays unsigned: {error:#}", recording.display()),
            }
            before
        };
        let thread = std::thread::Builder::new().name("finish".to_owned()).spawn(finish);
        self.running = Some(thread.context("cannot start a thread that finishes the recording")?);
        Ok(())
    }

    /// Waits for all recordings.
    ///
    /// # Errors
    /// One could not be written.
    pub(super) fn finish(&mut self) -> anyhow::Result<()> {
        self.running.take().map_or(Ok(()), join)
    }
}

fn join(thread: JoinHandle<anyhow::Result<()>>) -> anyhow::Result<()> {
    thread.join().unwrap_or_else(|_| Err(anyhow!("the thread that finishes a recording panicked")))
}

impl Drop for Finisher {
    fn drop(&mut self) {
        if let Err(error) = self.finish() {
            warn!("{error:#}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn a_slow_disk_delays_no_later_recording_and_its_error_is_returned() {
        let mut finisher = Finisher::new(None);
        let (release, held) = crossbeam_channel::bounded::<()>(0);
        let slow = move || -> anyhow::Result<()> {
            held.recv_timeout(Duration::from_secs(90))?;
            Err(anyhow!("the disk is full"))
        };
        finisher.start(Path::new("a.mcap"), "", slow).unwrap();
        finisher.start(Path::new("b.mcap"), "", || Ok(())).unwrap();
        release.send_timeout((), Duration::from_secs(90)).expect("the first one is still being written");
        assert_eq!(finisher.finish().unwrap_err().to_string(), "the disk is full");
        finisher.finish().unwrap();
    }
}
