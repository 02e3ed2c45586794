//! The finding as text for a terminal.

use std::fmt;

use equipoise_core::effect::Effect;

use crate::finding::{Finding, Generic, Named, Verdict, percent};

use super::Compared;

/// Text form of a finding.
#[derive(Debug, Clone, Copy)]
pub struct Summary<'a> {
    /// The comparison.
    pub compared: &'a Compared,
    /// The finding.
    pub finding: &'a Finding,
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (session, identified) = (&self.compared.session, &self.compared.identified);
        writeln!(f, "{}", self.compared.spans.description)?;
        let still = session.blocks.iter().filter(|block| block.still).count();
        writeln!(
            f,
            "worker: {:.1} kg, identified from {} static poses and {} motion samples; compared: {} blocks of {} s, \
             {still} of them static{}",
            session.mass_kg,
            identified.poses,
            identified.motion_samples,
            session.blocks.len(),
            session.block_s,
            session.left_out
        )?;
        let finding = self.finding;
        writeln!(f, "{}", verdict(finding))?;
        for named in &finding.effects {
            write!(f, "{}", EffectLine(named))?;
        }
        for Generic { what, log_odds } in &finding.unexplained {
            writeln!(f, "  unexplained: {what} (log odds {log_odds:.1})")?;
        }
        let gap = &finding.gap;
        writeln!(
            f,
            "gap: {:.1} mm before, {:.1} mm after on held-out data; noise alone: {:.1} mm",
            gap.before_mm, gap.after_mm, gap.noise_floor_mm
        )?;
        if let Some(ask) = &finding.ask_next {
            writeln!(f, "next measurement: {ask}")?;
        }
        Ok(())
    }
}

fn verdict(finding: &Finding) -> String {
    match (finding.verdict, finding.effects.len()) {
        (Verdict::Named, 1) => "named: the model lacks one effect".to_owned(),
        (Verdict::Named, count) => format!("named: the model lacks {count} effects"),
        (Verdict::None, _) => "none: these data show no effect that the model lacks".to_owned(),
        (Verdict::Ambiguous, _) => "ambiguous: the most likely effects are not certain".to_owned(),
        (Verdict::Unexplained, 0) => {
            "unexplained: the residual contains an effect that is not in the catalogue".to_owned()
        }
        (Verdict::Unexplained, _) => {
            "unexplained: in addition to the named effects, the residual contains one that is not in the catalogue"
                .to_owned()
        }
    }
}

/// One named effect.
struct EffectLine<'a>(&'a Named);

impl fmt::Display for EffectLine<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = self.0;
        write!(f, "  {}", named.name)?;
        for key in ["hand", "segment"] {
            if let Some(place) = named.place.get(key).and_then(serde_json::Value::as_str) {
                write!(f, " {place}")?;
            }
        }
        // In the order of the catalogue, which begins with the most relevant parameters.
        let order = Effect::from_name(&named.name).map(Effect::parameters).unwrap_or_default();
        let rank_of = |name: &str| order.iter().position(|entry| entry.name == name).unwrap_or(order.len());
        let mut parameters: Vec<_> = named.parameters.iter().collect();
        parameters.sort_by_key(|(name, _)| rank_of(name));
        for (name, estimate) in parameters {
            write!(f, ", {name} {:.4} ± {:.4}", estimate.value, estimate.sigma)?;
        }
        write!(f, " (probability {}, log odds {:.1}", percent(named.probability), named.log_odds)?;
        if let Some(next) = &named.runner_up {
            write!(f, "; in its place {} {}", next.name, percent(next.probability))?;
        }
        f.write_str(")\n")?;
        if !named.family.is_empty() {
            writeln!(f, "    not distinguishable by these data from: {}", named.family.join(", "))?;
        }
        Ok(())
    }
}
