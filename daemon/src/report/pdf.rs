//! The page as PDF, printed by Chromium where there is one.

use std::fmt::Write as _;
use std::fs::DirBuilder;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};

/// Under which names a Chromium is found.
const NAMES: [&str; 5] =
    ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chromium-headless-shell"];
/// Names a program in their place.
const VARIABLE: &str = "EQUIPOISE_CHROMIUM";
/// A report of a shift prints in seconds.
const PATIENCE: Duration = Duration::from_secs(120);

/// Prints a page into a file.
///
/// # Errors
/// There is no Chromium, it fails or takes too long, or the file cannot be written.
pub fn print(html: &str, pdf: &Path) -> anyhow::Result<()> {
    let Some(chromium) = found() else {
        bail!(
            "--pdf needs Chromium, and none is on this computer: install it (Debian, Ubuntu: `apt install chromium`), or \
             name one in {VARIABLE}; the HTML page itself prints as well"
        );
    };
    let room = Room::beside(pdf)?;
    let page = room.0.join("report.html");
    std::fs::write(&page, html).with_context(|| format!("cannot write {}", page.display()))?;
    let printed = room.0.join("report.pdf");
    let mut command = Command::new(&chromium);
    command
        .args(["--headless", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer"])
        .arg(argument("--user-data-dir=", &room.0.join("profile")))
        .arg(argument("--print-to-pdf=", &printed))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    // Its sandbox refuses to run as root; the page is ours, without a script, and may load nothing.
    if rustix::process::geteuid().is_root() {
        command.arg("--no-sandbox");
    }
    let child = command.arg(address(&page)).spawn();
    let name = chromium.display();
    let child = child.with_context(|| format!("cannot start {name}"))?;
    wait(child).with_context(|| format!("{name} did not print the report"))?;
    if !std::fs::metadata(&printed).is_ok_and(|printed| printed.len() > 0) {
        bail!("{name} ended without printing the report; can it read and write {}?", room.0.display());
    }
    std::fs::rename(&printed, pdf).with_context(|| format!("cannot write {}", pdf.display()))
}

fn argument(name: &str, path: &Path) -> std::ffi::OsString {
    let mut argument = std::ffi::OsString::from(name);
    argument.push(path);
    argument
}

/// The address of a file with an absolute path: what means something else in an address is written by its number.
fn address(path: &Path) -> String {
    let mut address = String::from("file://");
    for byte in path.as_os_str().as_bytes() {
        match byte {
            b'A'..=b'Z' | b'a'..=b'z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
                address.push(char::from(*byte));
            }
            _ => {
                let _ = write!(address, "%{byte:02X}");
            }
        }
    }
    address
}

fn found() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os(VARIABLE) {
        return Some(PathBuf::from(named));
    }
    let path = std::env::var_os("PATH")?;
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    NAMES.iter().find_map(|name| folders.iter().map(|folder| folder.join(name)).find(|file| file.is_file()))
}

fn wait(mut child: Child) -> anyhow::Result<()> {
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait()? {
            if status.success() {
                return Ok(());
            }
            bail!("it ended with {status}");
        }
        if started.elapsed() > PATIENCE {
            child.kill()?;
            child.wait()?;
            bail!("it took more than {} s", PATIENCE.as_secs());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// A folder for the owner alone beside the result, where a confined Chromium may write too; removed at the end.
struct Room(PathBuf);

impl Room {
    fn beside(pdf: &Path) -> anyhow::Result<Room> {
        let folder = match pdf.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        let folder =
            folder.canonicalize().with_context(|| format!("{}: no such folder", folder.display()))?;
        let room = folder.join(format!("equipoise-report-{}", std::process::id()));
        DirBuilder::new()
            .mode(0o700)
            .create(&room)
            .with_context(|| format!("cannot make {}", room.display()))?;
        Ok(Room(room))
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        // What stays behind is a folder with a plain name.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_a_folder_is_called_its_address_is_that_of_the_file() {
        assert_eq!(address(Path::new("/srv/shift_1/a-b.html")), "file:///srv/shift_1/a-b.html");
        let odd = address(Path::new("/Lager #3/50% ?/ä.html"));
        assert_eq!(odd, "file:///Lager%20%233/50%25%20%3F/%C3%A4.html");
    }
}
