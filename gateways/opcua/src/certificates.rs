//! The certificate folder: `own/cert.der`, `private/private.pem`, `trusted/`, `rejected/`.

use std::fs::{DirBuilder, Permissions};
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, bail};
use opcua::crypto::{CertificateStore, X509Data};
use tracing::{info, warn};

/// The server's certificate.
pub const OWN: &str = "own/cert.der";
/// The server's private key.
pub const KEY: &str = "private/private.pem";
/// Certificates of clients that may connect.
pub const TRUSTED: &str = "trusted";
/// Certificates of clients that were rejected.
pub const REJECTED: &str = "rejected";

/// Every rejected client leaves a file, so only the newest are kept.
const REJECTED_KEPT: usize = 50;
/// Ten years: renewal would need manual work, and clients trust this certificate itself, not an issuer.
const VALID_FOR_DAYS: u32 = 3650;
const KEY_BITS: u32 = 2048;

/// Default folder: `opcua` in the state directory.
///
/// # Errors
/// No environment variable names the state directory.
pub fn usual_folder() -> anyhow::Result<PathBuf> {
    let of = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let state = of("STATE_DIRECTORY")
        .or_else(|| of("XDG_STATE_HOME").map(|folder| folder.join("equipoise")))
        .or_else(|| of("HOME").map(|folder| folder.join(".local/state/equipoise")))
        .context("no folder for certificates: name one in gateways.opcua.pki")?;
    Ok(state.join("opcua"))
}

/// Creates the folder, and at the first start the key and the certificate. The key is readable by its owner only.
///
/// # Errors
/// The folder cannot be created or written, or contains only one of certificate and key.
pub fn prepare(pki: &Path, uri: &str, host: &str) -> anyhow::Result<()> {
    for folder in ["", "own", "private", TRUSTED, REJECTED] {
        let path = pki.join(folder);
        DirBuilder::new().recursive(true).mode(0o700).create(&path).with_context(|| {
            format!("cannot make {}, the folder of certificates (gateways.opcua.pki)", path.display())
        })?;
    }
    let (own, key) = (pki.join(OWN), pki.join(KEY));
    match (own.exists(), key.exists()) {
        (true, true) => warn_if_foreign(&own, uri),
        (false, false) => {
            let data = X509Data {
                key_size: KEY_BITS,
                common_name: "Equipoise".to_owned(),
                organization: "Equipoise".to_owned(),
                organizational_unit: "Station".to_owned(),
                country: "XX".to_owned(),
                state: "none".to_owned(),
                alt_host_names: X509Data::alt_host_names(uri, Some(vec![host.to_owned()]), true, true, false),
                certificate_duration_days: VALID_FOR_DAYS,
            };
            CertificateStore::create_certificate_and_key(&data, false, &own, &key)
                .map_err(|what| anyhow::anyhow!("cannot make a certificate in {}: {what}", pki.display()))?;
            info!("made a certificate: clients must trust {}", own.display());
        }
        _ => bail!(
            "{} and {} belong together, and one of them is missing: put it back, or remove the other too for new ones",
            own.display(),
            key.display()
        ),
    }
    std::fs::set_permissions(&key, Permissions::from_mode(0o600))
        .with_context(|| format!("cannot keep {} from others", key.display()))
}

fn warn_if_foreign(own: &Path, uri: &str) {
    let fits = CertificateStore::read_cert(own).is_ok_and(|own| own.is_application_uri_valid(uri).is_ok());
    if !fits {
        warn!(
            "{} is not of {uri}, so clients may refuse it: remove it and its key for new ones",
            own.display()
        );
    }
}

/// Deletes all but the newest rejected certificates.
pub fn remove_old_rejected(pki: &Path) {
    let Ok(entries) = std::fs::read_dir(pki.join(REJECTED)) else { return };
    let when = |entry: &std::fs::DirEntry| entry.metadata().and_then(|facts| facts.modified());
    let mut found: Vec<(SystemTime, PathBuf)> = entries
        .flatten()
        .map(|entry| (when(&entry).unwrap_or(SystemTime::UNIX_EPOCH), entry.path()))
        .collect();
    found.sort();
    for (_, path) in found.iter().rev().skip(REJECTED_KEPT) {
        let _ = std::fs::remove_file(path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_and_certificate_are_made_once_and_are_private() {
        let scratch = tempfile::tempdir().unwrap();
        let pki = scratch.path().join("state/opcua");
        prepare(&pki, "urn:a", "a.example").unwrap();
        let key = std::fs::read(pki.join(KEY)).unwrap();
        for (path, mode) in [(KEY, 0o600), ("private", 0o700), ("", 0o700)] {
            let found = std::fs::metadata(pki.join(path)).unwrap().permissions().mode() & 0o777;
            assert_eq!(found, mode, "{path}");
        }
        let own = CertificateStore::read_cert(&pki.join(OWN)).unwrap();
        assert!(own.is_application_uri_valid("urn:a").is_ok() && own.is_hostname_valid("a.example").is_ok());
        prepare(&pki, "urn:a", "a.example").unwrap();
        assert_eq!(std::fs::read(pki.join(KEY)).unwrap(), key);
        std::fs::remove_file(pki.join(OWN)).unwrap();
        assert!(prepare(&pki, "urn:a", "a.example").unwrap_err().to_string().contains("belong together"));
    }

    #[test]
    fn rejected_certificates_do_not_fill_the_disk() {
        let scratch = tempfile::tempdir().unwrap();
        let folder = scratch.path().join(REJECTED);
        std::fs::create_dir(&folder).unwrap();
        for index in 0..REJECTED_KEPT + 7 {
            std::fs::write(folder.join(format!("{index:03}.der")), "x").unwrap();
        }
        remove_old_rejected(scratch.path());
        let mut left: Vec<_> =
            std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        left.sort();
        assert_eq!(left.len(), REJECTED_KEPT);
        assert_eq!(left.last().unwrap(), "056.der");
    }
}
