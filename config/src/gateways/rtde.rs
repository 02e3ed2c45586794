//! `[gateways.rtde]`

use std::collections::BTreeMap;
use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use super::rtde_values::{DEFAULT, Register, Value};
use super::{Checked, between};

/// Registers that clients from outside may write; those below are the fieldbuses'.
const REGISTERS: std::ops::RangeInclusive<u8> = 24..=47;

/// `[gateways.rtde]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RtdeConfig {
    /// The robot's controller; its RTDE port is 30004.
    pub robot: SocketAddr,
    /// Registers are written so often, 1 to 500 Hz.
    #[serde(default = "default_rate_hz")]
    pub rate_hz: f64,
    /// Which value goes into which register, 24 to 47; the value's type determines whether `input_int_register_N` or
    /// `input_double_register_N` is meant.
    #[serde(default = "default_registers")]
    pub registers: BTreeMap<String, u8>,
}

fn default_rate_hz() -> f64 {
    125.0
}

fn default_registers() -> BTreeMap<String, u8> {
    DEFAULT.into_iter().map(|(name, number)| (name.to_owned(), number)).collect()
}

impl RtdeConfig {
    /// The registers in the order in which they are written.
    ///
    /// # Errors
    /// A name or number that cannot be used, in words for the person who wrote it.
    pub fn recipe(&self) -> Result<Vec<Register>, String> {
        let mut recipe = Vec::new();
        for (name, number) in &self.registers {
            let value = Value::of_name(name)
                .ok_or_else(|| format!("there is no value {name:?}; docs/consumers/rtde.md has the list"))?;
            if !REGISTERS.contains(number) {
                return Err(format!("{name} = {number}: registers 24 to 47 are for clients from outside"));
            }
            let register = Register { value, number: *number };
            if let Some(other) = recipe.iter().find(|other: &&Register| other.name() == register.name()) {
                let other = other.value.name();
                return Err(format!(
                    "{other} and {name} are both in {}: choose another number",
                    register.name()
                ));
            }
            recipe.push(register);
        }
        for needed in [Value::Sequence, Value::State] {
            if !recipe.iter().any(|register| register.value == needed) {
                let name = needed.name();
                return Err(format!(
                    "{name} is missing: inputs hold their last value, so the others could not be trusted"
                ));
            }
        }
        Ok(recipe)
    }

    pub(super) fn check(&self) -> Checked {
        self.recipe().map_err(|what| ("gateways.rtde.registers", what))?;
        between("gateways.rtde.rate_hz", self.rate_hz, 1.0, 500.0)
    }
}
