//! Damaged and arbitrary configurations fulfil the invariant that `fuzz/` tests for longer.

#[path = "laws/config.rs"]
mod config;

/// A reproducible sequence of pseudo-random numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % bound
    }
}

#[test]
fn damaged_configurations_are_accepted_or_refused_with_a_message() {
    let mut random = Random(7);
    let parts = [
        "=",
        "[ground]\n",
        "-1",
        "1e400",
        "nan",
        "\"",
        "\n",
        "#",
        "0x",
        "[[",
        "true",
        "source = \"text\"\n",
        "é",
    ];
    for seed in config::seeds() {
        config::check(&seed);
        for _ in 0..400 {
            let mut text = seed.clone();
            for _ in 0..=random.below(3) {
                let at = random.below(text.len());
                match random.below(3) {
                    0 => text[at] = random.below(128) as u8,
                    1 => drop(text.splice(at..at, parts[random.below(parts.len())].bytes())),
                    _ => drop(text.drain(at..(at + random.below(20)).min(text.len()))),
                }
            }
            config::check(&text);
        }
    }
}
