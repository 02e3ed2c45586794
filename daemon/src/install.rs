//! What `equipoise install` puts where, and `equipoise uninstall` takes away again: the program itself, and the files of
//! the service that it carries within it.

mod files;

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use files::{Put, put, remove};

/// Where the units expect the program; another prefix is written into them.
const PROGRAM_IN_UNITS: &str = "/usr/local/bin/equipoise";
/// Where systemd itself looks, whatever the prefix.
const PREFIXES_OF_SYSTEMD: [&str; 2] = ["/usr", "/usr/local"];
const UNITS: [(&str, &str); 3] = [
    ("equipoise.service", include_str!("../../systemd/equipoise.service")),
    ("equipoise-adapter@.service", include_str!("../../systemd/equipoise-adapter@.service")),
    ("equipoise-view.service", include_str!("../../systemd/equipoise-view.service")),
];
const SYSUSERS: &str = include_str!("../../systemd/sysusers.d/equipoise.conf");
const TMPFILES: &str = include_str!("../../systemd/tmpfiles.d/equipoise.conf");
const CONFIGURATION: &str = include_str!("../../systemd/equipoise.toml");
/// Where administrators' units and links are.
const ADMIN_UNITS: &str = "/etc/systemd/system";
/// What `--enable` links: the daemon at boot, and the page with the daemon.
const WANTED: [(&str, &str); 2] =
    [("multi-user.target.wants", "equipoise.service"), ("equipoise.service.wants", "equipoise-view.service")];
/// Neither is ever removed.
const DATA: [&str; 2] = ["/etc/equipoise", "/var/lib/equipoise"];

/// Where to install to.
#[derive(Debug, Clone)]
pub struct Place {
    prefix: PathBuf,
    root: PathBuf,
}

impl Place {
    /// The program goes to `prefix`, a path as it will be seen when it runs; everything below `root`, for packages.
    ///
    /// # Errors
    /// A prefix that a unit cannot name.
    pub fn new(prefix: &Path, root: &Path) -> anyhow::Result<Place> {
        let text = prefix.to_str().unwrap_or("");
        let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/._+-".contains(&byte);
        if !prefix.is_absolute() || text.contains("..") || !text.bytes().all(plain) {
            bail!(
                "--prefix {}: give an absolute path of letters, digits, '.', '_', '+' and '-'",
                prefix.display()
            );
        }
        // Without slashes at its end, which paths are compared without.
        Ok(Place { prefix: prefix.components().collect(), root: root.to_owned() })
    }

    fn program(&self) -> PathBuf {
        self.prefix.join("bin/equipoise")
    }

    /// A folder of systemd's: beside the program where systemd looks there, among the administrator's otherwise.
    fn folder(&self, beside: &str, admin: &str) -> PathBuf {
        let looked_at = PREFIXES_OF_SYSTEMD.iter().any(|prefix| self.prefix == Path::new(prefix));
        if looked_at { self.prefix.join(beside) } else { PathBuf::from(admin) }
    }

    fn units(&self) -> PathBuf {
        self.folder("lib/systemd/system", ADMIN_UNITS)
    }

    /// The text files: paths as they are when it runs, and what is in them.
    fn texts(&self) -> Vec<(PathBuf, String)> {
        let program = self.program();
        let unit = |text: &str| text.replace(PROGRAM_IN_UNITS, &program.to_string_lossy());
        let mut texts: Vec<_> =
            UNITS.iter().map(|(name, text)| (self.units().join(name), unit(text))).collect();
        let conf = |folder: PathBuf| folder.join("equipoise.conf");
        texts.push((conf(self.folder("lib/sysusers.d", "/etc/sysusers.d")), SYSUSERS.to_owned()));
        texts.push((conf(self.folder("lib/tmpfiles.d", "/etc/tmpfiles.d")), TMPFILES.to_owned()));
        texts
    }

    /// Where a path lies while it is installed.
    fn under_root(&self, path: &Path) -> PathBuf {
        self.root.join(path.strip_prefix("/").unwrap_or(path))
    }
}

/// Puts everything in place; again and again does no more than once. Gives lines that say what was done.
///
/// # Errors
/// A file cannot be written; what was written before it stays.
pub fn install(place: &Place, program: &Path, enable: bool) -> anyhow::Result<Vec<String>> {
    let mut done = Vec::new();
    let content = std::fs::read(program).with_context(|| format!("cannot read {}", program.display()))?;
    let mut write = |path: &Path, content: &[u8], mode| -> anyhow::Result<Put> {
        let outcome = put(&place.under_root(path), content, mode)?;
        let word = if outcome == Put::Written { "installed" } else { "unchanged" };
        done.push(format!("{word} {}", path.display()));
        Ok(outcome)
    };
    write(&place.program(), &content, 0o755)?;
    for (path, text) in place.texts() {
        write(&path, text.as_bytes(), 0o644)?;
    }
    let configuration = Path::new("/etc/equipoise/equipoise.toml");
    match std::fs::read(place.under_root(configuration)) {
        Ok(existing) if existing != CONFIGURATION.as_bytes() => {
            let sample = configuration.with_extension("toml.new");
            write(&sample, CONFIGURATION.as_bytes(), 0o644)?;
            done.push(format!(
                "kept {} as it is; the sample of this release is beside it as {}",
                configuration.display(),
                sample.display()
            ));
        }
        _ => drop(write(configuration, CONFIGURATION.as_bytes(), 0o644)?),
    }
    for (folder, unit) in WANTED.iter().filter(|_| enable) {
        let link = Path::new(ADMIN_UNITS).join(folder).join(unit);
        files::link(&place.under_root(&link), &place.units().join(unit))?;
        done.push(format!("enabled {unit}"));
    }
    done.extend(hidden(place));
    Ok(done)
}

/// Units by hand of the same name come first for systemd: whoever has some must know.
fn hidden(place: &Place) -> Vec<String> {
    let admin = Path::new(ADMIN_UNITS);
    let others = UNITS.iter().map(|(name, _)| admin.join(name)).filter(|_| place.units() != admin);
    others
        .filter(|path| place.under_root(path).exists())
        .map(|path| format!("note: {} was put there by hand and is used instead; remove it", path.display()))
        .collect()
}

/// Takes away what [`install`] put there, and nothing else. Gives lines that say what was done.
///
/// # Errors
/// A file cannot be removed.
pub fn uninstall(place: &Place) -> anyhow::Result<Vec<String>> {
    let mut done = Vec::new();
    let mut take = |path: &Path| -> anyhow::Result<()> {
        if remove(&place.under_root(path))? {
            done.push(format!("removed {}", path.display()));
        }
        Ok(())
    };
    for link in links(place) {
        take(&link)?;
    }
    for (path, _) in place.texts() {
        take(&path)?;
    }
    take(&place.program())?;
    for data in DATA.iter().filter(|data| place.under_root(Path::new(data)).exists()) {
        done.push(format!("left {data} as it is: configuration and workers are yours to delete"));
    }
    if done.is_empty() {
        done.push(format!("nothing is installed under {}", place.prefix.display()));
    }
    Ok(done)
}

/// Links that enable our units, adapters among them, whoever made them.
fn links(place: &Place) -> Vec<PathBuf> {
    let ours = |name: &str| {
        UNITS.iter().any(|(unit, _)| name == *unit)
            || (name.starts_with("equipoise-adapter@") && name.ends_with(".service"))
    };
    let admin = Path::new(ADMIN_UNITS);
    let mut links = Vec::new();
    for folder in std::fs::read_dir(place.under_root(admin)).into_iter().flatten().flatten() {
        let name = folder.file_name();
        if !name.to_string_lossy().ends_with(".wants") {
            continue;
        }
        for link in std::fs::read_dir(folder.path()).into_iter().flatten().flatten() {
            if link.file_type().is_ok_and(|kind| kind.is_symlink())
                && ours(&link.file_name().to_string_lossy())
            {
                links.push(admin.join(&name).join(link.file_name()));
            }
        }
    }
    links.sort();
    links
}

#[cfg(test)]
mod tests;
