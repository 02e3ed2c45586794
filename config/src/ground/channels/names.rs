//! Looks up channels by the names in a description.

use crate::ground::description_error::{DescriptionError, nearest};

/// Names of a device's channels, and which of them are used.
#[derive(Debug)]
pub(in crate::ground) struct Names<'a> {
    names: &'a [String],
    used: Vec<bool>,
}

impl<'a> Names<'a> {
    pub(in crate::ground) fn new(names: &'a [String]) -> Names<'a> {
        Names { names, used: vec![false; names.len()] }
    }

    pub(super) fn count(&self) -> usize {
        self.names.len()
    }

    /// Index of a required channel; `key` is the configuration key that refers to it.
    pub(super) fn find(&mut self, name: &str, key: &str) -> Result<usize, DescriptionError> {
        self.lookup(name).ok_or_else(|| {
            let hint = nearest(name, self.names.iter().map(String::as_str));
            DescriptionError::new(key, format!("no channel is called `{name}`{hint}"))
        })
    }

    /// Index of a channel, if it exists.
    pub(super) fn lookup(&mut self, name: &str) -> Option<usize> {
        let index = self.names.iter().position(|entry| entry == name)?;
        self.used[index] = true;
        Some(index)
    }

    /// Names that no key refers to.
    pub(in crate::ground) fn unused(&self) -> impl Iterator<Item = &str> {
        self.names.iter().zip(&self.used).filter(|(_, used)| !**used).map(|(name, _)| name.as_str())
    }
}
