//! Feeds the page: one more consumer of the bus, that takes the newest state and nothing else.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::Context;
use equipoise_bus::{Bus, BusError, BusSettings};
use equipoise_core::body::Skeleton;
use equipoise_core::message::State;
use equipoise_core::pose_suggestion::library::LIBRARY;
use equipoise_view::page::{Page, PageFrame};
use equipoise_view::suggested_pose::SuggestedPose;

use crate::config::Config;
use crate::config::method::StopConfig;
use crate::model::suggestion;

/// How often the newest state is looked for.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// The newest state, once there is one.
#[derive(Debug, Default)]
pub struct Newest(Arc<Mutex<Option<State>>>);

/// Starts the thread that takes the newest state of a station off the bus; it ends once nobody holds [`Newest`].
///
/// # Errors
/// The system gives no thread.
pub fn follow(station: &str) -> std::io::Result<(JoinHandle<()>, Newest)> {
    let newest = Newest::default();
    let seen = Arc::downgrade(&newest.0);
    let station = station.to_owned();
    // The bus's ports belong to one thread, so this one has them.
    let thread = std::thread::Builder::new().name("page-feed".into()).spawn(move || {
        let outcome: Result<(), BusError> = (|| {
            let bus = Bus::join(&BusSettings::new(&station, "page"))?;
            let mut states = bus.subscriber::<State>(1)?;
            while let Some(newest) = seen.upgrade() {
                if let (Some(state), Ok(mut newest)) = (states.latest()?, newest.lock()) {
                    *newest = Some(state);
                }
                std::thread::sleep(LOOK_EVERY);
            }
            Ok(())
        })();
        if let Err(error) = outcome {
            tracing::warn!("the page has no data: {error}");
        }
    })?;
    Ok((thread, newest))
}

/// Serves the page.
///
/// # Errors
/// The port is taken.
pub fn serve(listen: SocketAddr, config: &Config, newest: Newest) -> anyhow::Result<Page> {
    let skeleton = Skeleton::nominal(config.subject.height_m);
    let target_m = (config.identification.stop == StopConfig::PredictedCop)
        .then_some(config.identification.stop_cop_sigma_mm * 1e-3);
    let ask = config.loaded_model.as_ref().and_then(|model| model.file().ask.clone());
    let feed = move || {
        let state = newest.0.lock().ok().and_then(|newest| *newest)?;
        let suggested = LIBRARY.get(state.suggested_pose as usize).map(|posture| {
            let pose = SuggestedPose::on_the_spot(posture, &skeleton, &state.segment_origin_m);
            SuggestedPose { name: suggestion(&state, ask.as_ref()).unwrap_or(pose.name.clone()), ..pose }
        });
        let mut frame = PageFrame::new(state);
        frame.suggested = suggested;
        frame.cop_sigma_target_m = target_m;
        Some(frame)
    };
    Page::start(listen, feed).context("page.listen")
}
