//! Static files of the pages, embedded in the program. `view/web` builds them; `view/assets/LIBRARIES.md` lists the
//! libraries in them.

const HTML: &str = "text/html; charset=utf-8";
const SCRIPT: &str = "text/javascript; charset=utf-8";
const STYLE: &str = "text/css; charset=utf-8";

/// A file: path on the server, content type, content.
pub(super) type Asset = (&'static str, &'static str, &'static str);

/// All files.
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
