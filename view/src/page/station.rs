//! Interface between the engineer's page and the station.

use std::fmt;
use std::sync::Arc;

use super::token::Token;

/// Maximum length of a subject's id (`Command::subject`).
const SUBJECT_CHARS_MAX: usize = 64;

/// Commands from the engineer's page to the daemon.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PageCommand {
    /// Start identification from held poses.
    IdentifyStart,
    /// End identification and monitor with the present estimate.
    IdentifyStop,
    /// Discard all poses and restart identification.
    IdentifyReset,
    /// Suggest another pose.
    PoseSkip,
    /// Set the reading of the empty plate as zero.
    Tare,
    /// Load a stored profile by its pseudonymous id.
    SubjectLoad(String),
}

impl PageCommand {
    /// The command of a URL `/api/command/NAME` or `/api/command/NAME/SUBJECT`; `None` if there is no such command, or
    /// its subject is missing, superfluous or invalid.
    pub(super) fn named(name: &str, subject: Option<&str>) -> Option<PageCommand> {
        match (name, subject) {
            ("identify-start", None) => Some(PageCommand::IdentifyStart),
            ("identify-stop", None) => Some(PageCommand::IdentifyStop),
            ("identify-reset", None) => Some(PageCommand::IdentifyReset),
            ("pose-skip", None) => Some(PageCommand::PoseSkip),
            ("tare", None) => Some(PageCommand::Tare),
            ("subject-load", Some(id)) if is_id(id) => Some(PageCommand::SubjectLoad(id.to_owned())),
            _ => None,
        }
    }
}

fn is_id(text: &str) -> bool {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-_".contains(&byte);
    (1..=SUBJECT_CHARS_MAX).contains(&text.len()) && text.bytes().all(plain)
}

/// Provides data beyond the states. All methods are called on threads of the page, never on the loop's.
pub trait Station: Send + Sync + 'static {
    /// Current facts as a JSON object: incidents, sensors, latencies, contents of the filter. Called about once a
    /// second while there are viewers. Must not block.
    fn facts(&self) -> String;

    /// Time series of the last minutes as a JSON object, for a page that is opened later. Must not block.
    fn history(&self) -> String;

    /// The report on effects that the model lacks, an HTML file; `None` if there is none. May block on the disk.
    fn report(&self) -> Option<String>;

    /// Pseudonymous ids of the stored profiles, in alphabetical order. May block on the disk.
    ///
    /// # Errors
    /// The profiles cannot be listed; contains the text for the page.
    fn subjects(&self) -> Result<Vec<String>, String>;

    /// Sends a command to the daemon and returns its reply. May block on the daemon, about two seconds.
    ///
    /// # Errors
    /// The daemon refuses or does not reply; contains the text for the page.
    fn command(&self, command: &PageCommand) -> Result<String, String>;
}

/// The engineer's part of a page.
#[derive(Clone)]
pub struct Engineer {
    /// Source of the data.
    pub station: Arc<dyn Station>,
    /// Token that every command must contain; without it the page accepts none.
    pub command_token: Option<Token>,
}

impl fmt::Debug for Engineer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Engineer").field("command_token", &self.command_token).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_has_a_subject_if_and_only_if_it_needs_one() {
        assert_eq!(PageCommand::named("tare", None), Some(PageCommand::Tare));
        assert_eq!(PageCommand::named("tare", Some("anon-1")), None);
        assert_eq!(PageCommand::named("subject-load", None), None);
        let loaded = PageCommand::named("subject-load", Some("anon_1-B"));
        assert_eq!(loaded, Some(PageCommand::SubjectLoad("anon_1-B".to_owned())));
        for wrong in ["", "..", "a/b", "a b", "\u{e9}", &"a".repeat(65)] {
            assert_eq!(PageCommand::named("subject-load", Some(wrong)), None, "{wrong}");
        }
        assert_eq!(PageCommand::named("subject-delete", Some("anon-1")), None);
    }
}
