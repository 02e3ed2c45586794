//! Reads the page's two tokens from their files.

use std::path::Path;

use anyhow::Context;
use equipoise_config::PageConfig;
use equipoise_files::secret::{self, Readers};
use equipoise_view::Token;
use equipoise_view::page::{TOKEN_CHARS_MAX, TOKEN_CHARS_MIN};

/// The tokens of a page.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PageTokens {
    /// Token for viewing the page.
    pub(crate) page: Option<Token>,
    /// Token for commands.
    pub(crate) command: Option<Token>,
}

impl PageTokens {
    /// Reads the configured files; `base` is the folder to which a relative path refers.
    ///
    /// # Errors
    /// A sentence that begins with the key's name: a file is missing, is not a regular file, is readable by users other
    /// than owner and group, contains no token, or both files contain the same token.
    pub(crate) fn read(config: &PageConfig, base: &Path) -> anyhow::Result<PageTokens> {
        let read = |file: &Option<std::path::PathBuf>, key: &'static str| {
            file.as_ref().map(|file| token(&base.join(file))).transpose().context(key)
        };
        let page = read(&config.token_file, "page.token_file")?;
        let command = read(&config.command_token_file, "page.command_token_file")?;
        anyhow::ensure!(
            !matches!((&page, &command), (Some(a), Some(b)) if a.is_the_same_as(b)),
            "page.command_token_file: holds the token of page.token_file, so that every viewer may command; make \
             another with `equipoise token --out FILE`"
        );
        Ok(PageTokens { page, command })
    }
}

fn token(path: &Path) -> anyhow::Result<Token> {
    let text = secret::read_for(path, Readers::Group)
        .with_context(|| format!("no token ({0}); `equipoise token --out FILE` makes one", path.display()))?;
    Token::new(text.trim_end_matches(['\r', '\n'])).with_context(|| {
        format!(
            "the token in {} must be {TOKEN_CHARS_MIN} to {TOKEN_CHARS_MAX} letters, digits, '-', '.', '_' or '~' in one \
             line; `equipoise token` makes one",
            path.display()
        )
    })
}
