//! Section on the positions of the body.

use crate::report::document::Section;

use super::super::stick_figure::scrubber;
use super::Facts;

/// The body over time, as a stick figure.
pub(in crate::session_report) fn body(facts: &Facts) -> Section {
    let mut section = Section::new("Body positions");
    let Some(scrubber) = scrubber(&facts.body, facts.surface_z_m) else {
        section.paragraph("No pose of the suit was valid, so there is no figure.");
        return section;
    };
    section.scrubber(scrubber);
    section.note(format!(
        "One position every {:.1} s with a valid pose: that at which a joint was closest to its limit, or the first one. \
         First displayed: that of the whole session. Views relative to the pelvis heading, centred between the ankles; \
         left limbs are grey. Dots: joints at level medium or above (larger dot, higher level), or not sure. Bars: the \
         highest level of all joints, as in the drawing of the levels; none while torques were withheld.",
        facts.body.interval_s()
    ));
    section
}
