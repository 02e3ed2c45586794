//! The files that `equipoise install` installs and `equipoise uninstall` removes: the program itself, those next to it, and
//! the service files embedded in it.

mod files;
mod links;
mod others;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use files::{InstallResult, install_file, remove};

pub use others::PROGRAMS;

/// Path of the program in the embedded units, and begin of those of the others; replaced under another prefix.
const PROGRAM_IN_UNITS: &str = "/usr/local/bin/equipoise";
/// Prefixes that systemd searches for units.
const PREFIXES_OF_SYSTEMD: [&str; 2] = ["/usr", "/usr/local"];
/// The program of the daemon's unit; located in the directory of `equipoise`.
const DAEMON: &str = "equipoise-daemon";
const UNITS: [(&str, &str); 6] = [
    ("equipoise.service", include_str!("../../systemd/equipoise.service")),
    ("equipoise-adapter@.service", include_str!("../../systemd/equipoise-adapter@.service")),
    ("equipoise-metrics.service", include_str!("../../systemd/equipoise-metrics.service")),
    ("equipoise-gateway@.service", include_str!("../../systemd/equipoise-gateway@.service")),
    ("equipoise-record.service", include_str!("../../systemd/equipoise-record.service")),
    ("equipoise-view.service", include_str!("../../systemd/equipoise-view.service")),
];
const SYSUSERS: &str = include_str!("../../systemd/sysusers.d/equipoise.conf");
const TMPFILES: &str = include_str!("../../systemd/tmpfiles.d/equipoise.conf");
const CONFIGURATION: &str = include_str!("../../systemd/equipoise.toml");
/// Directory of the administrator's units and links.
const ADMIN_UNITS: &str = "/etc/systemd/system";
/// Links that `--enable` creates, each with its target: the daemon starts at boot, sensors and page with the daemon.
const ENABLED_LINKS: [(&str, &str, &str); 4] = [
    ("multi-user.target.wants", "equipoise.service", "equipoise.service"),
    ("equipoise.service.wants", "equipoise-adapter@suit.service", "equipoise-adapter@.service"),
    ("equipoise.service.wants", "equipoise-adapter@ground.service", "equipoise-adapter@.service"),
    ("equipoise.service.wants", "equipoise-view.service", "equipoise-view.service"),
];
const CONFIGURATION_FILE: &str = "/etc/equipoise/equipoise.toml";
/// Unit and data of gateways in the previous release.
const OLD_GATEWAY_UNIT: &str = "equipoise-outlet@.service";
const OLD_GATEWAY_DATA: &str = "/var/lib/equipoise-outlets";
/// User data: never removed.
const DATA: [&str; 4] =
    ["/etc/equipoise", "/var/lib/equipoise", "/var/lib/equipoise-gateways", OLD_GATEWAY_DATA];

/// Destination of the installation.
#[derive(Debug, Clone)]
pub struct Destination {
    prefix: PathBuf,
    root: PathBuf,
}

impl Destination {
    /// `prefix`: final prefix of the program on the running system; `root`: directory below which all files are
    /// written, for packaging.
    ///
    /// # Errors
    /// The prefix cannot be written in a unit file.
    pub fn new(prefix: &Path, root: &Path) -> anyhow::Result<Destination> {
        let text = prefix.to_str().unwrap_or("");
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/._+-".contains(&byte);
        if !prefix.is_absolute() || text.contains("..") || !text.bytes().all(plain) {
            bail!(
                "--prefix {}: give an absolute path of letters, digits, '.', '_', '+' and '-'",
                prefix.display()
            );
        }
        // Without trailing slashes, so that paths compare equal.
        Ok(Destination { prefix: prefix.components().collect(), root: root.to_owned() })
    }

    fn program(&self) -> PathBuf {
        self.program_named("equipoise")
    }

    fn program_named(&self, name: &str) -> PathBuf {
        self.prefix.join("bin").join(name)
    }

    /// Destination of systemd files: below the prefix if systemd searches there, otherwise among the administrator's
    /// files.
    fn folder(&self, below_prefix: &str, admin: &str) -> PathBuf {
        let is_searched = PREFIXES_OF_SYSTEMD.iter().any(|prefix| self.prefix == Path::new(prefix));
        if is_searched { self.prefix.join(below_prefix) } else { PathBuf::from(admin) }
    }

    fn units(&self) -> PathBuf {
        self.folder("lib/systemd/system", ADMIN_UNITS)
    }

    /// Text files to install: path on the running system, and content.
    fn text_files(&self) -> Vec<(PathBuf, String)> {
        let program = self.program();
        let unit = |text: &str| text.replace(PROGRAM_IN_UNITS, &program.to_string_lossy());
        let mut files: Vec<_> =
            UNITS.iter().map(|(name, text)| (self.units().join(name), unit(text))).collect();
        let conf = |folder: PathBuf| folder.join("equipoise.conf");
        files.push((conf(self.folder("lib/sysusers.d", "/etc/sysusers.d")), SYSUSERS.to_owned()));
        files.push((conf(self.folder("lib/tmpfiles.d", "/etc/tmpfiles.d")), TMPFILES.to_owned()));
        files
    }

    /// Path of a file during installation.
    fn under_root(&self, path: &Path) -> PathBuf {
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// As [`Self::under_root`], for paths that will be changed. Rejects links below a root other than `/`: their
    /// targets are relative to the installed system and may lead out of the root.
    fn checked_under_root(&self, path: &Path) -> anyhow::Result<PathBuf> {
        let mut found = self.root.clone();
        for part in path.strip_prefix("/").unwrap_or(path).components() {
            found.push(part);
            if self.root != Path::new("/") && found.is_symlink() {
                bail!("{} is a link, and might lead out of --root: put a folder there", found.display());
            }
        }
        Ok(found)
    }

    /// As [`Self::checked_under_root`], for a path that may itself be a link: it is replaced or removed, not followed.
    fn link_under_root(&self, link: &Path) -> anyhow::Result<PathBuf> {
        let folder = self.checked_under_root(link.parent().unwrap_or(Path::new("/")))?;
        Ok(folder.join(link.file_name().unwrap_or_default()))
    }
}

/// Installs everything: `program`, the daemon and those of [`PROGRAMS`] in the same directory. Idempotent. Returns lines that
/// describe the changes.
///
/// # Errors
/// A file cannot be written; files written before remain.
pub fn install(destination: &Destination, program: &Path, enable: bool) -> anyhow::Result<Vec<String>> {
    let mut done = Vec::new();
    let read = |path: &Path| std::fs::read(path).with_context(|| format!("cannot read {}", path.display()));
    let daemon = program.with_file_name(DAEMON);
    let daemon = read(&daemon)
        .context("the daemon is a program of its own: cargo build --release -p equipoise-daemon")?;
    let mut write = |path: &Path, content: &[u8], mode| -> anyhow::Result<InstallResult> {
        let outcome = install_file(&destination.checked_under_root(path)?, content, mode)?;
        let action = if outcome == InstallResult::Written { "installed" } else { "unchanged" };
        done.push(format!("{action} {}", path.display()));
        Ok(outcome)
    };
    write(&destination.program(), &read(program)?, 0o755)?;
    write(&destination.program_named(DAEMON), &daemon, 0o755)?;
    for name in others::next_to(program) {
        write(&destination.program_named(name), &read(&program.with_file_name(name))?, 0o755)?;
    }
    for (path, text) in destination.text_files() {
        write(&path, text.as_bytes(), 0o644)?;
    }
    let configuration = Path::new(CONFIGURATION_FILE);
    match std::fs::read(destination.checked_under_root(configuration)?) {
        Ok(existing) if existing != CONFIGURATION.as_bytes() => {
            let sample = configuration.with_extension("toml.new");
            write(&sample, CONFIGURATION.as_bytes(), 0o644)?;
            done.push(format!(
                "kept {} as it is; the sample of this release is next to it as {}",
                configuration.display(),
                sample.display()
            ));
        }
        _ => drop(write(configuration, CONFIGURATION.as_bytes(), 0o644)?),
    }
    for (folder, unit, file) in ENABLED_LINKS.iter().filter(|_| enable) {
        let link = Path::new(ADMIN_UNITS).join(folder).join(unit);
        files::link(&destination.link_under_root(&link)?, &destination.units().join(file))?;
        done.push(format!("enabled {unit}"));
    }
    done.extend(others::missing(destination, program));
    done.extend(others::configured(destination));
    done.extend(old_gateway_unit(destination));
    done.extend(units_overridden_by_admin(destination));
    Ok(done)
}

/// Notes on units of the administrator with the same name: systemd prefers them.
fn units_overridden_by_admin(destination: &Destination) -> Vec<String> {
    let admin = Path::new(ADMIN_UNITS);
    let others = UNITS.iter().map(|(name, _)| admin.join(name)).filter(|_| destination.units() != admin);
    others
        .filter(|path| destination.under_root(path).exists())
        .map(|path| format!("note: {} overrides the installed unit; remove it", path.display()))
        .collect()
}

/// A note about the unit of gateways of the previous release, which still works until it is replaced.
fn old_gateway_unit(destination: &Destination) -> Option<String> {
    let unit = destination.units().join(OLD_GATEWAY_UNIT);
    destination.under_root(&unit).exists().then(|| {
        format!(
            "note: equipoise-gateway@ replaces {}: systemctl disable --now each equipoise-outlet@KIND, enable \
             equipoise-gateway@KIND, and remove the file. Certificates of OPC UA: move {OLD_GATEWAY_DATA}/opcua to \
             /var/lib/equipoise-gateways/",
            unit.display()
        )
    })
}

/// Removes the files that [`install`] created, and nothing else. Returns lines that describe the changes.
///
/// # Errors
/// A file cannot be removed.
pub fn uninstall(destination: &Destination) -> anyhow::Result<Vec<String>> {
    let mut done = Vec::new();
    // systemd's directories are shared by all prefixes: their files may belong to another installation.
    let (others, own): (Vec<_>, Vec<_>) = destination
        .text_files()
        .into_iter()
        .partition(|(path, text)| differs_from_release(&destination.under_root(path), text));
    for (path, _) in &others {
        let prefix = destination.prefix.display();
        done.push(format!("left {}: not what this release installs for {prefix}", path.display()));
    }
    let units = destination.units();
    let has_foreign_units = others.iter().any(|(path, _)| path.starts_with(&units));
    let mut remove_and_report = |path: &Path| -> anyhow::Result<()> {
        if remove(&destination.link_under_root(path)?)? {
            done.push(format!("removed {}", path.display()));
        }
        Ok(())
    };
    for link in links::to(destination, |unit| own.iter().any(|(path, _)| path == unit)) {
        remove_and_report(&link)?;
    }
    // User and directory definitions are shared by all prefixes: keep them while another installation's service needs
    // them.
    for (path, _) in own.iter().filter(|(path, _)| path.starts_with(&units) || !has_foreign_units) {
        remove_and_report(path)?;
    }
    remove_and_report(&destination.program())?;
    remove_and_report(&destination.program_named(DAEMON))?;
    for name in PROGRAMS {
        remove_and_report(&destination.program_named(name))?;
    }
    for data in DATA.iter().filter(|data| destination.under_root(Path::new(data)).exists()) {
        done.push(format!(
            "left {data} as it is: the configuration and the stored profiles are yours to delete"
        ));
    }
    if done.is_empty() {
        done.push(format!("nothing is installed under {}", destination.prefix.display()));
    }
    Ok(done)
}

/// Whether the file exists and its content is not that of this release.
fn differs_from_release(path: &Path, text: &str) -> bool {
    path.symlink_metadata().is_ok() && !std::fs::read(path).is_ok_and(|existing| existing == text.as_bytes())
}

#[cfg(test)]
mod tests;
