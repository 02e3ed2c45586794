//! Settings page of an ATI Net F/T or Axia, `http://DEVICE/netftapi2.xml`: scale, units and output settings.
//!
//! Source: ATI Net F/T manual 9620-05-Net FT, "netftapi2.xml". Accepts unit names as in the manual, and as in some
//! firmware; an undefined name is never guessed.

use crate::units::{METRE_PER_FOOT, METRE_PER_INCH, NEWTON_PER_KGF, NEWTON_PER_LBF};
use quick_xml::Reader;
use quick_xml::events::Event;

/// The page's name on the device.
pub const PATH: &str = "/netftapi2.xml";

/// The fields of the page that are used. `None` if the page lacks the field.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NetFtPage {
    /// Counts per unit of force: `cfgcpf`, on old devices `calcpf`.
    pub counts_per_force: Option<f64>,
    /// Counts per unit of torque: `cfgcpt`, on old devices `calcpt`.
    pub counts_per_torque: Option<f64>,
    /// Name of the unit of force: `scfgfu`.
    pub force_unit: Option<String>,
    /// Name of the unit of torque: `scfgtu`.
    pub torque_unit: Option<String>,
    /// Whether RDT is switched on: `comrdte`.
    pub rdt_enabled: Option<bool>,
    /// Records a second: `comrdtrate`.
    pub rdt_rate_hz: Option<f64>,
}

/// Why a page is not one of a Net F/T.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PageFault {
    /// Not XML.
    #[error("it is no XML: {0}")]
    NotXml(String),
    /// XML of another kind.
    #[error("it has neither cfgcpf nor calcpf, so it is no page of a Net F/T")]
    NotNetFt,
    /// An invalid number.
    #[error("its {name} is \"{text}\", which is not a positive number")]
    NotANumber {
        /// The element.
        name: &'static str,
        /// The contents.
        text: String,
    },
}

/// The elements that are read.
const NAMES: [&str; 8] =
    ["cfgcpf", "cfgcpt", "calcpf", "calcpt", "scfgfu", "scfgtu", "comrdte", "comrdtrate"];

impl NetFtPage {
    /// Parses a page.
    ///
    /// # Errors
    /// A [`PageFault`] if it is another kind of page, or its numbers are invalid.
    pub fn parse(text: &str) -> Result<NetFtPage, PageFault> {
        let texts = texts(text)?;
        let of = |name: &'static str| {
            let index = NAMES.iter().position(|known| *known == name);
            index.and_then(|index| texts.get(index)).and_then(Option::as_deref)
        };
        let number = |name: &'static str| {
            let Some(text) = of(name) else { return Ok(None) };
            match text.parse::<f64>() {
                Ok(number) if number > 0.0 && number.is_finite() => Ok(Some(number)),
                _ => Err(PageFault::NotANumber { name, text: text.chars().take(40).collect() }),
            }
        };
        let either = |new: &'static str, old: &'static str| match number(new)? {
            None => number(old),
            found => Ok(found),
        };
        let page = NetFtPage {
            counts_per_force: either("cfgcpf", "calcpf")?,
            counts_per_torque: either("cfgcpt", "calcpt")?,
            force_unit: of("scfgfu").map(str::to_owned),
            torque_unit: of("scfgtu").map(str::to_owned),
            rdt_enabled: of("comrdte").map(|text| text.eq_ignore_ascii_case("enabled") || text == "1"),
            rdt_rate_hz: of("comrdtrate").and_then(|text| text.parse().ok()),
        };
        if page.counts_per_force.is_none() { Err(PageFault::NotNetFt) } else { Ok(page) }
    }
}

/// The text of each of [`NAMES`]; the first of several elements with the same name.
fn texts(text: &str) -> Result<[Option<String>; NAMES.len()], PageFault> {
    let mut found = [const { None }; NAMES.len()];
    let mut reader = Reader::from_str(text);
    // Index of the open element, and its text so far.
    let mut open: Option<(usize, String)> = None;
    loop {
        match reader.read_event().map_err(|error| PageFault::NotXml(error.to_string()))? {
            Event::Start(start) => {
                let name = start.local_name();
                let is = |known: &&str| name.as_ref().eq_ignore_ascii_case(known);
                open = NAMES.iter().position(is).map(|index| (index, String::new()));
            }
            Event::Text(piece) => {
                if let Some((_, text)) = &mut open {
                    text.push_str(&piece.xml10_content());
                }
            }
            Event::End(_) => {
                if let Some((index, text)) = open.take()
                    && let Some(place) = found.get_mut(index)
                {
                    place.get_or_insert_with(|| text.trim().to_owned());
                }
            }
            Event::Eof => return Ok(found),
            _ => {}
        }
    }
}

/// Newtons per unit of force, by ATI's name of the unit.
pub fn newtons_of(unit: &str) -> Option<f64> {
    Some(match plain(unit).as_str() {
        "n" => 1.0,
        "kn" => 1000.0,
        "lb" | "lbf" => NEWTON_PER_LBF,
        "klb" | "klbf" => 1000.0 * NEWTON_PER_LBF,
        "kg" | "kgf" => NEWTON_PER_KGF,
        "g" | "gf" => NEWTON_PER_KGF / 1000.0,
        _ => return None,
    })
}

/// Newton metres per unit of torque, by ATI's name of the unit.
pub fn newton_metres_of(unit: &str) -> Option<f64> {
    Some(match plain(unit).as_str() {
        "nm" => 1.0,
        "nmm" => 0.001,
        "knm" => 1000.0,
        "lbin" | "lbfin" | "inlb" | "inlbf" => NEWTON_PER_LBF * METRE_PER_INCH,
        "lbft" | "lbfft" | "ftlb" | "ftlbf" => NEWTON_PER_LBF * METRE_PER_FOOT,
        "kgcm" | "kgfcm" => NEWTON_PER_KGF / 100.0,
        "kgm" | "kgfm" => NEWTON_PER_KGF,
        _ => return None,
    })
}

/// Removes separators within a unit and converts it to lower case: none of these units depends on case.
fn plain(unit: &str) -> String {
    unit.chars()
        .filter(|letter| !matches!(letter, ' ' | '-' | '.' | '*' | '·' | '_'))
        .flat_map(char::to_lowercase)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const PAGE: &str = "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n<netft><runstat>0x00000000</runstat>\
        <setfwver> 2.0.14 </setfwver><cfgcpf>1000000</cfgcpf><cfgcpt> 500000 </cfgcpt><scfgfu>N</scfgfu>\
        <scfgtu>N-m</scfgtu><comrdte>Enabled</comrdte><comrdtrate>7000</comrdtrate><comrdtbsiz>40</comrdtbsiz></netft>";

    #[test]
    fn a_page_gives_counts_units_and_rate() {
        let page = NetFtPage::parse(PAGE).unwrap();
        assert_eq!((page.counts_per_force, page.counts_per_torque), (Some(1e6), Some(5e5)));
        assert_eq!((page.force_unit.as_deref(), page.torque_unit.as_deref()), (Some("N"), Some("N-m")));
        assert_eq!((page.rdt_enabled, page.rdt_rate_hz), (Some(true), Some(7000.0)));
        let off = NetFtPage::parse(&PAGE.replace("Enabled", "Disabled")).unwrap();
        assert_eq!(off.rdt_enabled, Some(false));
        let old = NetFtPage::parse(&PAGE.replace("cfgcpf", "calcpf").replace("cfgcpt", "calcpt")).unwrap();
        assert_eq!((old.counts_per_force, old.counts_per_torque), (Some(1e6), Some(5e5)));
    }

    #[test]
    fn what_is_no_page_says_what_it_is() {
        assert_eq!(NetFtPage::parse("<html><body>404</body></html>"), Err(PageFault::NotNetFt));
        assert!(matches!(NetFtPage::parse("<netft><cfgcpf>1</wrong>"), Err(PageFault::NotXml(_))));
        let said = NetFtPage::parse(&PAGE.replace("1000000", "many")).unwrap_err().to_string();
        assert_eq!(said, "its cfgcpf is \"many\", which is not a positive number");
        assert!(NetFtPage::parse(&PAGE.replace(" 500000 ", "0")).is_err());
    }

    #[test]
    fn units_are_known_by_name_or_not_at_all() {
        for (name, newtons) in
            [("N", 1.0), ("kN", 1000.0), ("lbf", 4.448_221_615_260_5), ("Klbf", 4_448.221_615_260_5)]
        {
            assert_eq!(newtons_of(name), Some(newtons), "{name}");
        }
        assert_eq!((newtons_of("kg"), newtons_of("gf")), (Some(9.806_65), Some(0.009_806_65)));
        for (name, newton_metres) in
            [("N-m", 1.0), ("Nm", 1.0), ("N-mm", 0.001), ("kN-m", 1000.0), ("kg-cm", 0.098_066_5)]
        {
            assert_eq!(newton_metres_of(name), Some(newton_metres), "{name}");
        }
        let inch = newton_metres_of("lbf-in").unwrap();
        assert!((inch - 0.112_984_829_027_616_7).abs() < 1e-15, "{inch}");
        assert!((newton_metres_of("lb-ft").unwrap() / inch - 12.0).abs() < 1e-12);
        for unit in ["", "oz", "dyn", "m", "Pa"] {
            assert_eq!((newtons_of(unit), newton_metres_of(unit)), (None, None), "{unit}");
        }
    }

    proptest! {
        #[test]
        fn whatever_comes_nothing_panics(text in ".*", cut in 0usize..400) {
            let _ = NetFtPage::parse(&text);
            let _ = NetFtPage::parse(PAGE.get(..cut.min(PAGE.len())).unwrap_or_default());
        }
    }
}
