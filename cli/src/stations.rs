//! Several stations on one page: requests the newest state and facts of each station's page, on this or other machines.

use std::net::Ipv6Addr;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use equipoise_adapters::source::http::HttpClient;
use equipoise_config::PageConfig;
use equipoise_core::overload::Level;
use equipoise_files::read_text;
use equipoise_files::secret::{self, Readers};
use equipoise_view::Page;
use equipoise_view::words::{JointLoad, headline_of};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::page_tokens::PageTokens;

/// Interval of the requests to a station.
const REQUEST_INTERVAL: Duration = Duration::from_millis(500);
/// A state is not displayed after this time without an answer, or once a request has failed.
const STATE_FOR: Duration = Duration::from_secs(2);
/// A station is lost after this time without an answer; longer than the interval and the time limit of two requests.
const LOST_AFTER: Duration = Duration::from_secs(6);
/// Maximum size of the file, bytes.
const FILE_BYTES_MAX: u64 = 1 << 20;
/// Keys of a state that the page displays.
const STATE_KEYS: [&str; 8] = [
    "phase",
    "valid",
    "worst_joint",
    "lifted_mass_kg",
    "lifted_mass_sigma_kg",
    "lifts",
    "dose_probability",
    "joints",
];

/// The file of `equipoise view --stations`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct StationsFile {
    /// Address and token of this page.
    pub(crate) page: PageConfig,
    /// The stations, in the order of the page.
    station: Vec<StationEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StationEntry {
    /// Address of the station's page.
    url: String,
    /// File with the token of that page.
    token_file: Option<PathBuf>,
}

impl StationsFile {
    /// Reads the file.
    ///
    /// # Errors
    /// The file cannot be read or is invalid.
    pub(crate) fn read(path: &Path) -> anyhow::Result<StationsFile> {
        let text =
            read_text(path, FILE_BYTES_MAX).with_context(|| format!("cannot read {}", path.display()))?;
        let file: StationsFile = toml::from_str(&text).with_context(|| path.display().to_string())?;
        ensure!(!file.station.is_empty(), "{}: no [[station]]: add one, with its url", path.display());
        for StationEntry { url, .. } in &file.station {
            ensure!(
                is_page_address(url),
                "{}: {url}: give the address of a station's page, http://HOST:PORT/; a token belongs to token_file",
                path.display()
            );
        }
        Ok(file)
    }
}

/// Whether a text is `http://HOST:PORT/`, the port being optional, with or without a path.
fn is_page_address(url: &str) -> bool {
    let Some(rest) = url.strip_prefix("http://") else { return false };
    let (authority, path) = rest.split_once('/').unwrap_or((rest, ""));
    let (host, port) = match authority.rsplit_once(':') {
        Some((host, port)) if !authority.ends_with(']') => (host, port),
        _ => (authority, "80"),
    };
    let is_host = match host.strip_prefix('[').and_then(|host| host.strip_suffix(']')) {
        Some(address) => address.parse::<Ipv6Addr>().is_ok(),
        None => {
            !host.is_empty()
                && host.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-._".contains(&byte))
        }
    };
    is_host
        && port.parse::<u16>().is_ok_and(|port| port > 0)
        && path.bytes().all(|byte| byte.is_ascii_graphic() && !b"?#".contains(&byte))
}

/// The newest answers of a station.
#[derive(Debug, Default)]
struct Tile {
    /// The state; `None` if the station's page has none.
    state: Option<Value>,
    /// Facts of the engineer's page.
    facts: Option<Value>,
    /// Why there is no answer.
    error: Option<String>,
    answered: Option<Instant>,
}

impl Tile {
    fn to_json(&self, url: &str) -> Value {
        let connection = match (self.answered, &self.state) {
            (Some(answered), _) if answered.elapsed() > LOST_AFTER => "lost",
            (Some(answered), _) if self.error.is_some() || answered.elapsed() > STATE_FOR => "waiting",
            (Some(_), Some(_)) => "live",
            (Some(_), None) => "silent",
            (None, _) if self.error.is_some() => "lost",
            (None, _) => "waiting",
        };
        let is_answered = matches!(connection, "live" | "silent");
        let fact = |key: &str| self.facts.as_ref().and_then(|facts| facts.get(key)).cloned();
        json!({
            "url": url,
            "connection": connection,
            // Kept while the station is lost.
            "station": fact("station"),
            "state": self.state.as_ref().filter(|_| connection == "live"),
            "incidents": fact("incidents").filter(|_| is_answered),
            "error": self.error.as_ref().filter(|_| !is_answered),
        })
    }
}

type Tiles = Vec<(String, Mutex<Tile>)>;

/// The page being served, and the threads that request the stations.
pub(crate) struct ServedStations {
    page: Page,
    /// The threads end when this reference is dropped.
    tiles: Option<Arc<Tiles>>,
    threads: Vec<JoinHandle<()>>,
    snapshots: Arc<AtomicU64>,
}

impl ServedStations {
    /// Serves the page; `base` is the folder to which relative files refer.
    ///
    /// # Errors
    /// The port is taken, or a token cannot be read.
    pub(crate) fn start(file: StationsFile, base: &Path) -> anyhow::Result<ServedStations> {
        let PageTokens { page: token, .. } = PageTokens::read(&file.page, base)?;
        let mut secrets = Vec::new();
        for StationEntry { url, token_file } in &file.station {
            let read = |path: &PathBuf| secret::read_for(&base.join(path), Readers::Group);
            let secret =
                token_file.as_ref().map(read).transpose().with_context(|| format!("token_file of {url}"))?;
            secrets.push(secret.map(|text| text.trim_end_matches(['\r', '\n']).to_owned()));
        }
        let tiles: Arc<Tiles> =
            Arc::new(file.station.into_iter().map(|station| (station.url, Mutex::default())).collect());
        let shown = Arc::downgrade(&tiles);
        let snapshots = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&snapshots);
        let feed = move || {
            counted.fetch_add(1, Ordering::Relaxed);
            snapshot(&shown).to_string()
        };
        let page = Page::start_overview(file.page.listen, token, feed).context("page.listen")?;
        let threads = secrets.into_iter().enumerate().map(|(index, secret)| {
            let tiles = Arc::downgrade(&tiles);
            std::thread::Builder::new()
                .name(format!("station-{index}"))
                .spawn(move || request_until_dropped(&tiles, index, secret.as_deref()))
        });
        let threads = threads.collect::<std::io::Result<_>>()?;
        Ok(ServedStations { page, tiles: Some(tiles), threads, snapshots })
    }

    /// Address for a browser.
    pub(crate) fn url(&self) -> String {
        self.page.url()
    }

    /// Whether server and threads are running.
    pub(crate) fn is_running(&self) -> bool {
        self.page.is_running() && self.threads.iter().all(|thread| !thread.is_finished())
    }

    /// Number of snapshots requested by the page's thread: increments twice a second while the thread runs.
    pub(crate) fn snapshots(&self) -> u64 {
        self.snapshots.load(Ordering::Relaxed)
    }
}

impl Drop for ServedStations {
    fn drop(&mut self) {
        self.tiles = None;
        for thread in self.threads.drain(..) {
            // The thread itself has printed its panic.
            let _ = thread.join();
        }
    }
}

fn lock(tile: &Mutex<Tile>) -> MutexGuard<'_, Tile> {
    tile.lock().unwrap_or_else(PoisonError::into_inner)
}

fn snapshot(tiles: &Weak<Tiles>) -> Value {
    let tiles = tiles.upgrade();
    tiles.iter().flat_map(|tiles| tiles.iter()).map(|(url, tile)| lock(tile).to_json(url)).collect()
}

fn request_until_dropped(tiles: &Weak<Tiles>, index: usize, token: Option<&str>) {
    let client = HttpClient::new();
    while let Some(tiles) = tiles.upgrade() {
        let (url, tile) = &tiles[index];
        let answer = request(&client, url, token);
        let mut tile = lock(tile);
        match answer {
            Ok((state, facts)) => {
                *tile = Tile { state, facts: Some(facts), error: None, answered: Some(Instant::now()) };
            }
            Err(error) => tile.error = Some(format!("{error:#}")),
        }
        drop(tile);
        drop(tiles);
        std::thread::sleep(REQUEST_INTERVAL);
    }
}

/// State and facts of a station.
fn request(client: &HttpClient, url: &str, token: Option<&str>) -> anyhow::Result<(Option<Value>, Value)> {
    let get = |path: &str| -> anyhow::Result<(u16, Value)> {
        let address = format!("{}{path}", url.trim_end_matches('/'));
        let answer = match token {
            Some(token) => client.get_with_token(&address, token)?,
            None => client.get(&address)?,
        };
        ensure!(matches!(answer.status, 200 | 503), "{}: {}", answer.status, answer.text.trim_end());
        Ok((
            answer.status,
            serde_json::from_str(&answer.text)
                .context("the answer is not JSON: url must be the address of a station's page")?,
        ))
    };
    let (_, facts) = get("/api/station")?;
    // 503: the daemon is silent.
    let (status, state) = get("/api/state")?;
    Ok(((status == 200).then(|| displayed(&state)), facts))
}

/// The part of a state that the page displays.
fn displayed(state: &Value) -> Value {
    let kept = STATE_KEYS.iter().filter_map(|key| Some(((*key).to_owned(), state.get(key)?.clone())));
    let mut kept: Map<String, Value> = kept.collect();
    if let Some((name, level, mut joint)) = displayed_joint(state) {
        joint["level"] = level.name().into();
        kept.insert("worst_joint".to_owned(), name.into());
        kept.insert("joint".to_owned(), joint);
    }
    kept.remove("joints");
    Value::Object(kept)
}

/// Name, certain level and values of the joint that the tile displays.
fn displayed_joint(state: &Value) -> Option<(&str, Level, Value)> {
    let (worst, joints) = (state.get("worst_joint")?.as_str()?, state.get("joints")?.as_object()?);
    let loads = joints.iter().map(|(name, joint)| (name.as_str(), load_of(joint)));
    let (name, level) = headline_of(&worst, loads)?;
    Some((name, level, joints.get(name)?.clone()))
}

fn load_of(joint: &Value) -> JointLoad {
    let level = joint.get("level").and_then(Value::as_str);
    let torque_nm = joint.get("torque_nm").and_then(Value::as_array);
    let squares =
        torque_nm.into_iter().flatten().filter_map(Value::as_f64).map(|component| component * component);
    let or_infinite = |key| joint.get(key).and_then(Value::as_f64).unwrap_or(f64::INFINITY);
    JointLoad {
        level: (0..)
            .map_while(Level::from_number)
            .find(|one| Some(one.name()) == level)
            .unwrap_or(Level::None),
        torque_nm: squares.sum::<f64>().sqrt(),
        sigma_nm: or_infinite("sigma_nm"),
        limit_nm: or_infinite("limit_nm"),
    }
}

#[cfg(test)]
mod tests;
