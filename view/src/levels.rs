//! Display of the overload levels: one table, `levels.json`, for page, terminal, session report and Foxglove.

use std::sync::LazyLock;

use equipoise_core::overload::Level;
use serde::Deserialize;

/// How a level is displayed. Sign and size distinguish the levels without colour.
#[derive(Debug, Clone, Deserialize)]
pub struct LevelStyle {
    /// Public name of the level.
    pub name: String,
    /// Colour, `#rrggbb`.
    pub colour: String,
    /// Colour of a sign or text on it, `#rrggbb`.
    pub ink: String,
    /// One character, one column wide.
    pub sign: String,
    /// Relative size of the ball on a joint; 1 for the highest level.
    pub size: f64,
}

impl LevelStyle {
    /// The style of a level.
    pub fn of(level: Level) -> &'static LevelStyle {
        &TABLE[level as usize]
    }

    /// Red, green and blue of the colour.
    pub fn rgb(&self) -> [u8; 3] {
        rgb(&self.colour)
    }

    /// Red, green and blue of the ink.
    pub fn ink_rgb(&self) -> [u8; 3] {
        rgb(&self.ink)
    }
}

// In the order of the levels' numbers. The tests parse it, so this cannot fail.
static TABLE: LazyLock<[LevelStyle; 6]> = LazyLock::new(|| {
    serde_json::from_str(include_str!("levels.json")).expect("levels.json is a table of six levels")
});

/// Precedence of a level where one of several is displayed: an undecided joint is never called low, and never masks a
/// decided level above low.
pub fn severity(level: Level) -> u8 {
    match level {
        Level::None => 0,
        Level::Green => 1,
        Level::Undecided => 2,
        Level::Orange => 3,
        Level::Red => 4,
        Level::AboveMax => 5,
    }
}

fn rgb(colour: &str) -> [u8; 3] {
    let [_, red, green, blue] =
        u32::from_str_radix(colour.trim_start_matches('#'), 16).unwrap_or(0).to_be_bytes();
    [red, green, blue]
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Level; 6] =
        [Level::None, Level::Green, Level::Orange, Level::Red, Level::AboveMax, Level::Undecided];

    #[test]
    fn every_level_has_its_row() {
        for level in ALL {
            let style = LevelStyle::of(level);
            assert_eq!(style.name, level.name());
            assert_eq!(style.sign.chars().count(), 1, "{}", style.name);
            for colour in [&style.colour, &style.ink] {
                let digits = colour.strip_prefix('#').unwrap();
                assert!(digits.len() == 6 && digits.bytes().all(|byte| byte.is_ascii_hexdigit()), "{colour}");
            }
        }
        assert_eq!(LevelStyle::of(Level::Green).rgb(), [0x00, 0x9e, 0x73]);
    }

    #[test]
    fn documents_and_the_dashboard_have_the_same_colours() {
        let page = include_str!("../../docs/page.md").replace('\n', " ");
        let dashboard = include_str!("../../clients/zenoh/dashboard.py");
        for level in ALL {
            let style = LevelStyle::of(level);
            let entry = format!("`{}` {} `{}`", style.name, style.sign, style.colour);
            assert!(page.contains(&entry), "docs/page.md lacks {entry}");
            if matches!(level, Level::None | Level::Undecided) {
                continue;
            }
            let ([r, g, b], [x, y, z]) = (style.ink_rgb(), style.rgb());
            let escape = format!("\"{}\": \"\\033[38;2;{r};{g};{b};48;2;{x};{y};{z}m\"", style.name);
            assert!(dashboard.contains(&escape), "dashboard.py lacks {escape}");
        }
    }
}
