//! What the engineer's page needs beyond frames, and who provides it.

use std::fmt;
use std::sync::Arc;

use super::token::Token;

/// The most characters of a subject's id (`Command::subject`).
const SUBJECT_CHARS_MAX: usize = 64;

/// What the engineer's page may ask of the daemon.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PageCommand {
    /// Learn from held poses from now on.
    IdentifyStart,
    /// End learning and monitor with what is known.
    IdentifyStop,
    /// Forget every pose and start anew.
    IdentifyReset,
    /// Ask for another pose.
    PoseSkip,
    /// Take what the empty plate shows as zero.
    Tare,
    /// Load a stored profile by its pseudonymous id.
    SubjectLoad(String),
}

impl PageCommand {
    /// The command of an address `/api/command/NAME` or `/api/command/NAME/SUBJECT`; `None` if there is no such command,
    /// or its subject is missing, out of place, or no id.
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

/// Who knows more of the station than its states. All of it is asked for on threads of the page, never on the loop's.
pub trait Station: Send + Sync + 'static {
    /// The facts of the moment as a JSON object: incidents, sensors, latencies, what the filter holds. Asked for about
    /// once a second, and only while somebody looks. Must not block.
    fn facts(&self) -> String;

    /// How numbers went over the last minutes, as a JSON object, for whoever opens the page late. Must not block.
    fn history(&self) -> String;

    /// The report on what the model lacks, an HTML file; `None` if none was written. May wait for the disk.
    fn report(&self) -> Option<String>;

    /// Asks the daemon; its sentence, or why not. May wait for the daemon, two seconds or so.
    ///
    /// # Errors
    /// The daemon refuses, or does not answer: the sentence that says so.
    fn command(&self, command: &PageCommand) -> Result<String, String>;
}

/// The engineer's part of a page.
#[derive(Clone)]
pub struct Engineer {
    /// Who knows.
    pub station: Arc<dyn Station>,
    /// What every command must bring; without it the page takes none.
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
