//! Several stations on one page: requests the newest state and facts of each station's page, on this or other machines.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use equipoise_adapters::source::http::HttpClient;
use equipoise_config::PageConfig;
use equipoise_files::read_text;
use equipoise_files::secret::{self, Readers};
use equipoise_view::Page;
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::page_tokens::PageTokens;

/// Interval of the requests to a station.
const REQUEST_INTERVAL: Duration = Duration::from_millis(500);
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
                url.starts_with("http://") && !url.contains(['?', '#']),
                "{}: {url}: give the address of a station's page, http://HOST:PORT/; a token belongs to token_file",
                path.display()
            );
        }
        Ok(file)
    }
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
        let page = Page::start_overview(file.page.listen, token, move || snapshot(&shown).to_string())
            .context("page.listen")?;
        let threads = secrets.into_iter().enumerate().map(|(index, secret)| {
            let tiles = Arc::downgrade(&tiles);
            std::thread::Builder::new()
                .name(format!("station-{index}"))
                .spawn(move || request_until_dropped(&tiles, index, secret.as_deref()))
        });
        let threads = threads.collect::<std::io::Result<_>>()?;
        Ok(ServedStations { page, tiles: Some(tiles), threads })
    }

    /// Address for a browser.
    pub(crate) fn url(&self) -> String {
        self.page.url()
    }

    /// Whether server and threads are running.
    pub(crate) fn is_running(&self) -> bool {
        self.page.is_running() && self.threads.iter().all(|thread| !thread.is_finished())
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
    let worst =
        kept.get("worst_joint").and_then(Value::as_str).and_then(|name| state.get("joints")?.get(name));
    match worst.cloned() {
        Some(worst) => kept.insert("joint".to_owned(), worst),
        None => None,
    };
    kept.remove("joints");
    Value::Object(kept)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::State;
    use equipoise_view::Token;
    use equipoise_view::page::{Engineer, PageCommand, PageFrame, Station};

    const TOKEN: &str = "of-the-test-0123456789abcdefghij";

    struct Facts;

    impl Station for Facts {
        fn facts(&self) -> String {
            json!({ "station": "press-1", "incidents": [{ "name": "suit_silent", "active": true }] })
                .to_string()
        }

        fn history(&self) -> String {
            "{}".to_owned()
        }

        fn report(&self) -> Option<String> {
            None
        }

        fn subjects(&self) -> Result<Vec<String>, String> {
            Ok(Vec::new())
        }

        fn command(&self, _: &PageCommand) -> Result<String, String> {
            Err("none".to_owned())
        }
    }

    fn station(live: bool) -> Page {
        let mut state = State { worst_joint: 0, lifted_mass_kg: 8.0, ..State::zeroed() };
        (state.torque_nm[0], state.torque_limit_nm[0]) = ([0.0, 30.0, 40.0], 100.0);
        let feed = move || {
            (state.cycle, state.time_ns) = (state.cycle + 1, state.time_ns + 1);
            live.then(|| PageFrame::new(state))
        };
        let engineer = Engineer { station: Arc::new(Facts), command_token: None };
        Page::start_with("127.0.0.1:0".parse().unwrap(), Token::new(TOKEN), feed, Some(engineer)).unwrap()
    }

    fn file(text: &str) -> anyhow::Result<StationsFile> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("stations.toml");
        std::fs::write(&path, text).unwrap();
        StationsFile::read(&path)
    }

    #[test]
    fn a_tile_is_live_silent_or_lost() {
        let folder = tempfile::tempdir().unwrap();
        let token = folder.path().join("token");
        std::fs::write(&token, TOKEN).unwrap();
        std::fs::set_permissions(&token, std::fs::Permissions::from_mode(0o600)).unwrap();
        let pages = [station(true), station(false)];
        let mut text = "[page]\nlisten = \"127.0.0.1:0\"\n".to_owned();
        for page in &pages {
            text += &format!("[[station]]\nurl = \"{}\"\ntoken_file = \"token\"\n", page.url());
        }
        // Without the token, and an address that nothing serves.
        text += &format!(
            "[[station]]\nurl = \"{}\"\n[[station]]\nurl = \"http://127.0.0.1:1/\"\n",
            pages[0].url()
        );
        let served = ServedStations::start(file(&text).unwrap(), folder.path()).unwrap();
        let client = HttpClient::new();
        let stations = || -> Value {
            serde_json::from_str(&client.get(&format!("{}api/stations", served.url())).unwrap().text).unwrap()
        };
        let begun = Instant::now();
        let is = |all: &Value| {
            ["live", "silent", "lost", "lost"]
                .iter()
                .zip(all.as_array().unwrap())
                .all(|(one, tile)| tile["connection"] == *one)
        };
        while !is(&stations()) {
            assert!(begun.elapsed() < Duration::from_secs(30), "{}", stations());
            std::thread::sleep(Duration::from_millis(50));
        }
        let all = stations();
        assert_eq!(
            (&all[0]["station"], &all[0]["state"]["worst_joint"]),
            (&json!("press-1"), &json!("L5S1"))
        );
        assert_eq!(
            (&all[0]["state"]["joint"]["limit_nm"], &all[0]["state"]["lifted_mass_kg"]),
            (&json!(100.0), &json!(8.0))
        );
        assert_eq!(all[0]["incidents"][0]["name"], "suit_silent");
        assert!(all[0]["state"].get("joints").is_none() && all[1]["state"].is_null(), "{all}");
        assert!(all[2]["error"].as_str().unwrap().starts_with("401: This page needs its token"), "{all}");
        assert!(all[3]["error"].is_string() && served.is_running());
    }

    #[test]
    fn a_file_with_another_form_is_refused_with_a_remedy() {
        let page = "[page]\nlisten = \"127.0.0.1:0\"\n";
        for (text, expected) in [
            (page.to_owned() + "station = []", "unknown field"),
            (format!("station = []\n{page}"), "no [[station]]"),
            (format!("{page}[[station]]\nurl = \"press-1:8080\""), "http://HOST:PORT/"),
            (format!("{page}[[station]]\nurl = \"http://a/?token=b\""), "token_file"),
        ] {
            let error = format!("{:#}", file(&text).unwrap_err());
            assert!(error.contains(expected), "{error}");
        }
    }
}
