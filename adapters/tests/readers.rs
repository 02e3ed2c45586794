//! Tests the properties of every reader with valid, damaged and arbitrary bytes; `fuzz/` searches for longer.

mod laws;

use laws::{LAWS, found::FOUND};
use proptest::prelude::*;

#[test]
fn sound_inputs_and_former_findings_keep_their_laws() {
    for law in LAWS {
        let seeds = (law.seeds)();
        assert!(!seeds.is_empty(), "{}", law.name);
        for seed in seeds {
            (law.check)(&seed);
        }
        (law.check)(&[]);
    }
    for (name, bytes, _what) in FOUND {
        let law = LAWS.iter().find(|law| law.name == *name);
        (law.unwrap_or_else(|| panic!("no law {name}")).check)(bytes);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_inputs_keep_their_laws(
        hits in proptest::collection::vec((any::<u32>(), any::<u8>()), 1..8),
        cut in any::<u16>(), whole: bool, more in proptest::collection::vec(any::<u8>(), 0..40), at in any::<u32>(),
    ) {
        for law in LAWS {
            for mut seed in (law.seeds)() {
                for (at, value) in &hits {
                    let at = *at as usize % seed.len();
                    seed[at] = *value;
                }
                if !whole {
                    seed.truncate(usize::from(cut) % seed.len());
                }
                let at = at as usize % (seed.len() + 1);
                seed.splice(at..at, more.iter().copied());
                (law.check)(&seed);
            }
        }
    }

    #[test]
    fn arbitrary_bytes_keep_the_laws(bytes in proptest::collection::vec(any::<u8>(), 0..3000)) {
        for law in LAWS {
            (law.check)(&bytes);
        }
    }
}
