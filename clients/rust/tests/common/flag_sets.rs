//! The flag sets of the clients in other languages.

use equipoise_core::message::Validity;

/// Sets for single fields of a state, in addition to those of [`Validity::FLAG_SETS`].
const FIELD_SETS: [(Validity, &str); 3] = [
    (Validity::INVALIDATES_POSE, "pose"),
    (Validity::INVALIDATES_SUIT_COM, "suit_com"),
    (Validity::INVALIDATES_LOAD_HAND_DISTANCE, "load_hand_distance"),
];

/// All sets with their public names.
pub(crate) fn all() -> impl Iterator<Item = (Validity, &'static str)> {
    Validity::FLAG_SETS.iter().copied().chain(FIELD_SETS)
}
