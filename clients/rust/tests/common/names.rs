//! Spelling of the core's names in other languages.

/// `RightT4Shoulder` as `RIGHT_T4_SHOULDER`; `ground_force` as `GROUND_FORCE`.
pub(crate) fn constant_case(name: &str) -> String {
    let letters: Vec<char> = name.chars().collect();
    let mut out = String::new();
    for (at, letter) in letters.iter().enumerate() {
        let follows_a_word = at > 0 && letters[at - 1].is_lowercase();
        let begins_a_word = at > 0 && letters.get(at + 1).is_some_and(|next| next.is_lowercase());
        if letter.is_uppercase() && (follows_a_word || begins_a_word) {
            out.push('_');
        }
        out.extend(letter.to_uppercase());
    }
    out
}
