//! An error in a device description: the key, its position in the file, and the remedy.

use std::ops::Range;

use equipoise_adapters::source::SourceError;

use super::second::of_second;

/// An error in a description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mistake {
    /// The dotted key.
    pub key: String,
    /// Bytes of the file, if more precise than the key: for an entry of a list.
    pub span: Option<Range<usize>>,
    /// Description and remedy.
    pub what: String,
}

impl Mistake {
    pub(super) fn new(key: impl Into<String>, what: impl Into<String>) -> Mistake {
        Mistake { key: key.into(), span: None, what: what.into() }
    }

    /// Error at an entry of a list.
    pub(super) fn at<T>(
        entry: &toml::Spanned<T>,
        key: impl Into<String>,
        what: impl Into<String>,
    ) -> Mistake {
        Mistake { span: Some(entry.span()), ..Mistake::new(key, what) }
    }

    /// The same error in the section of the second device.
    pub(super) fn of_second(self) -> Mistake {
        Mistake { key: of_second(&self.key), what: of_second(&self.what), span: self.span }
    }
}

impl From<(&'static str, String)> for Mistake {
    fn from((key, what): (&'static str, String)) -> Mistake {
        Mistake::new(key, what)
    }
}

/// For a description that is used without a previous check.
impl From<Mistake> for SourceError {
    fn from(mistake: Mistake) -> SourceError {
        SourceError::Unusable(format!("{}: {}", mistake.key, mistake.what))
    }
}

/// A hint with the existing name most similar to another one.
pub(super) fn nearest<'a>(name: &str, known: impl IntoIterator<Item = &'a str>) -> String {
    let nearest = known
        .into_iter()
        .max_by(|a, b| strsim::jaro_winkler(a, name).total_cmp(&strsim::jaro_winkler(b, name)));
    nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"))
}
