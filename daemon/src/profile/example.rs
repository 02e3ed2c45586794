//! Profiles for tests.

use equipoise_config::method::{Build, SexConfig};
use equipoise_core::body::{SEGMENTS, Skeleton};
use equipoise_core::cycle::identification::StoredSubject;
use equipoise_core::cycle::{Identification, Settings};
use equipoise_core::exposure::Shift;
use equipoise_core::frame::{Pose, rotation};
use equipoise_core::handover::experience::Experience;

use super::{Profile, unix_s};

/// The text of a profile with this number of poses and lifts.
pub(crate) fn text(subject: &str, lifts: u64, settings: &Settings) -> String {
    let mut worker = bytemuck::zeroed_box::<Identification>();
    worker.start(settings);
    let origin = Skeleton::nominal(settings.height_m).t_pose_m().map(Into::into);
    let pose = Pose::new(origin, [rotation([1.0, 0.0, 0.0, 0.0]); SEGMENTS]);
    while !worker.has_body() {
        worker.update_skeleton(&pose, settings);
    }
    let mut stored = bytemuck::zeroed_box::<StoredSubject>();
    worker.store(&mut stored);
    stored.poses_used = lifts;
    let shift = Shift { lifts, ended: lifts, ..bytemuck::Zeroable::zeroed() };
    let build = Build { height_m: settings.height_m, sex: SexConfig::Unstated };
    let profile = Profile::of(subject, build, &stored, &shift, &Experience::default(), unix_s()).unwrap();
    profile.to_toml().unwrap()
}
