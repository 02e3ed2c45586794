//! The files of the pages, inside the program. `view/web` builds them; `view/assets/LIBRARIES.md` says whose they are.

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";

/// A file: its path on the server, its type, its text.
pub(super) type Asset = (&'static str, &'static str, &'static str);

/// All of them.
pub(super) const ASSETS: [Asset; 8] = [
    ("/", HTML, include_str!("../../assets/worker.html")),
    ("/worker.js", SCRIPT, include_str!("../../assets/worker.js")),
    ("/worker.css", STYLE, include_str!("../../assets/worker.css")),
    ("/engineer", HTML, include_str!("../../assets/engineer.html")),
    ("/engineer.js", SCRIPT, include_str!("../../assets/engineer.js")),
    ("/engineer.css", STYLE, include_str!("../../assets/engineer.css")),
    ("/icon.svg", "image/svg+xml", include_str!("../../assets/icon.svg")),
    ("/libraries", "text/plain; charset=utf-8", include_str!("../../assets/LIBRARIES.md")),
];
