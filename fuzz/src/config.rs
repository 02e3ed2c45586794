//! The law of configurations, of `config/tests`.

#[path = "../../config/tests/laws/config.rs"]
mod law;

use crate::laws::Law;

pub(crate) const LAWS: [Law; 1] = [Law { name: "config", check: law::check, seeds: law::seeds }];
