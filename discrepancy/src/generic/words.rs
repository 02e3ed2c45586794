//! Display names of segments.

use equipoise_core::body::Segment;

/// Display name of a segment: "right forearm".
pub(crate) fn words(segment: Segment) -> String {
    let name = segment.name();
    let mut text = String::new();
    for (index, letter) in name.char_indices() {
        if letter.is_uppercase() && index > 0 && text.len() > 2 {
            text.push(' ');
        }
        text.push(letter.to_ascii_lowercase());
    }
    match segment {
        Segment::T8 => "upper trunk".to_owned(),
        Segment::L5 | Segment::L3 | Segment::T12 => "lower trunk".to_owned(),
        _ => text,
    }
}
