//! What the loop starts from: an empty memory, and the worker that was learnt before.

use equipoise_core::cycle::{Memory, Settings};
use tracing::{info, warn};

use crate::profile::Profile;
use crate::workers::{self, Workers};

/// The loop's memory, with what is known of the configured worker. A profile that cannot be used is left alone.
pub(super) fn remembered(settings: &Settings, workers: &Workers) -> Box<Memory> {
    let mut memory = bytemuck::zeroed_box::<Memory>();
    memory.start(settings);
    let Some(saving) = workers.get(workers::CONFIGURED).filter(|saving| saving.remember) else {
        return memory;
    };
    let known = Profile::read(&saving.path).map_err(|error| error.to_string()).and_then(|profile| {
        let Some(profile) = profile else { return Ok(None) };
        let worker = profile.worker(settings).map_err(|why| {
            format!("the profile {} is not used: {why}; it is left as it is", saving.path.display())
        })?;
        Ok(Some((profile, worker)))
    });
    match known {
        Ok(None) => {}
        Ok(Some((profile, worker))) => {
            let (poses, identified) = (profile.poses_used, profile.identified);
            info!(poses, identified, "profile {} is in use", profile.subject);
            memory.identification = *worker;
            // What the configuration says of the mass is newer than the profile.
            if let Some(mass_kg) = settings.mass_kg {
                memory.identification.mass_kg = mass_kg;
            }
        }
        Err(why) => {
            warn!("{why}; what is learnt now is not saved");
            workers.refuse(workers::CONFIGURED, format!("{why} (not overwritten; move it away and restart)"));
        }
    }
    memory
}
