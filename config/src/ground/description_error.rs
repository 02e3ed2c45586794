//! An error in a device description: the key, its position in the file, and the remedy.

use std::ops::Range;

use equipoise_adapters::source::SourceError;

use super::second::in_second;

/// An error in a description.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DescriptionError {
    /// The dotted key.
    pub key: String,
    /// Bytes of the file, if more precise than the key: for an entry of a list.
    pub span: Option<Range<usize>>,
    /// Description and remedy.
    pub what: String,
}

impl DescriptionError {
    pub(super) fn new(key: impl Into<String>, what: impl Into<String>) -> DescriptionError {
        DescriptionError { key: key.into(), span: None, what: what.into() }
    }

    /// Error at an entry of a list.
    pub(super) fn at<T>(
        entry: &toml::Spanned<T>,
        key: impl Into<String>,
        what: impl Into<String>,
    ) -> DescriptionError {
        DescriptionError { span: Some(entry.span()), ..DescriptionError::new(key, what) }
    }

    /// The same error in the section of the second device.
    pub(super) fn in_second(self) -> DescriptionError {
        DescriptionError { key: in_second(&self.key), what: in_second(&self.what), span: self.span }
    }
}

impl From<(&'static str, String)> for DescriptionError {
    fn from((key, what): (&'static str, String)) -> DescriptionError {
        DescriptionError::new(key, what)
    }
}

/// For a description that is used without a previous check.
impl From<DescriptionError> for SourceError {
    fn from(error: DescriptionError) -> SourceError {
        SourceError::Unusable(format!("{}: {}", error.key, error.what))
    }
}

/// A hint with the existing name most similar to another one.
pub(super) fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> String {
    let nearest = candidates
        .into_iter()
        .max_by(|a, b| strsim::jaro_winkler(a, name).total_cmp(&strsim::jaro_winkler(b, name)));
    nearest.map_or_else(String::new, |nearest| format!("; did you mean `{nearest}`?"))
}
