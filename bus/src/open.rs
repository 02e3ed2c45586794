//! Opening a service: what all kinds have in common.

use crate::error::BusError;
use crate::node::Bus;
use crate::service::SCHEMA_KEY;
use iceoryx2::prelude::{AttributeSet, AttributeVerifier, MessagingPattern, Service as _, ServiceName, ipc};
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeCreateError, PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseCreateError, RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use std::thread;
use std::time::{Duration, Instant};

/// Pause before another attempt, for a port or a service.
const PAUSE: Duration = Duration::from_millis(5);
/// Another process may be creating or removing the service, or removing the remains of a dead process. While it waits
/// for a processor of a busy machine, the service's files are as incomplete as damaged ones, and the dead keep their
/// places; files are damaged, and places taken, if they still are after this time.
const SETTLING_MAX: Duration = Duration::from_secs(3);

/// Why a service did not open, whatever its kind.
pub(crate) enum Refusal {
    /// Another process is creating or removing it, or a signal interrupted the attempt.
    InFlux(String),
    /// Other messages.
    Schema,
    Permission,
    Damaged,
    Settings(String),
    NodesFull,
    /// The attempt failed, whatever the settings of the service.
    Failed(String),
}

macro_rules! refusals {
    ($($Both:ident { $Open:ident: $types:pat, $Create:ident: $damaged:pat })*) => {
        $(impl From<$Both> for Refusal {
            fn from(error: $Both) -> Refusal {
                use {$Create as Create, $Open as Open};
                let detail = match error {
                    $Both::$Open(cause) => format!("{cause:?}"),
                    $Both::$Create(cause) => format!("{cause:?}"),
                    $Both::SystemInFlux => "SystemInFlux".to_owned(),
                };
                match error {
                    $Both::SystemInFlux
                    | $Both::$Open(Open::IsMarkedForDestruction | Open::DoesNotExist | Open::Interrupt)
                    | $Both::$Create(
                        Create::AlreadyExists | Create::IsBeingCreatedByAnotherInstance | Create::Interrupt,
                    ) => Refusal::InFlux(detail),
                    $Both::$Open(Open::InsufficientPermissions)
                    | $Both::$Create(Create::InsufficientPermissions) => Refusal::Permission,
                    $Both::$Open(Open::ServiceInCorruptedState | Open::HangsInCreation)
                    | $Both::$Create($damaged) => Refusal::Damaged,
                    $Both::$Open(Open::ExceedsMaxNumberOfNodes) => Refusal::NodesFull,
                    $Both::$Open($types) => Refusal::Schema,
                    $Both::$Open(Open::InternalFailure | Open::UnableToCreateServiceTag)
                    | $Both::$Create(
                        Create::InternalFailure
                        | Create::UnableToCreateServiceTag
                        | Create::ServiceConfigCouldNotBeCreated
                        | Create::UnableToGenerateUniqueServiceId,
                    ) => Refusal::Failed(detail),
                    // The remaining errors compare settings: limits, behaviour, pattern, version of iceoryx2.
                    _ => Refusal::Settings(detail),
                }
            }
        })*
    };
}

refusals! {
    PublishSubscribeOpenOrCreateError {
        PublishSubscribeOpenError: Open::IncompatibleTypes | Open::IncompatibleAttributes,
        PublishSubscribeCreateError: Create::ServiceInCorruptedState | Create::HangsInCreation
    }
    RequestResponseOpenOrCreateError {
        RequestResponseOpenError: Open::IncompatibleRequestOrResponseType | Open::IncompatibleAttributes,
        RequestResponseCreateError: Create::ServiceInCorruptedState | Create::HangsInCreation
    }
    EventOpenOrCreateError {
        EventOpenError: Open::IncompatibleAttributes,
        EventCreateError: Create::ServiceInCorruptedState
    }
}

/// Opens the service `name`, or creates it; `attempt` is handed its name and the attributes it must have.
pub(crate) fn open_or_create<F, E: Into<Refusal>>(
    bus: &Bus,
    name: &str,
    pattern: MessagingPattern,
    schema: &str,
    attempt: impl Fn(&ServiceName, &AttributeVerifier) -> Result<F, E>,
) -> Result<F, BusError> {
    let service_name = ServiceName::new(name).map_err(BusError::failed("name a service", name))?;
    let attributes = required(schema).map_err(BusError::failed("describe the schema", name))?;
    let started = Instant::now();
    let refusal = loop {
        let refusal = match attempt(&service_name, &attributes) {
            Ok(factory) => return Ok(factory),
            Err(error) => error.into(),
        };
        let may_pass = match refusal {
            Refusal::InFlux(_) | Refusal::Damaged => true,
            // Dead nodes occupy ports until they are removed.
            Refusal::NodesFull => bus.clear_away_the_dead() != (0, 0),
            _ => false,
        };
        if !may_pass || started.elapsed() > SETTLING_MAX {
            break refusal;
        }
        thread::sleep(PAUSE);
    };
    let service = name.to_owned();
    Err(match refusal {
        Refusal::Schema => {
            let theirs = schema_of(bus, &service_name, pattern);
            BusError::OtherSchema { service, theirs, ours: schema.to_owned() }
        }
        Refusal::Permission => BusError::Permission { service },
        Refusal::Damaged => BusError::Damaged { service, root: bus.root.clone() },
        Refusal::NodesFull => {
            BusError::Full { service, what: "participant", most: crate::service::NODES_MAX }
        }
        Refusal::Settings(detail) => BusError::OtherSettings { service, detail },
        Refusal::InFlux(detail) | Refusal::Failed(detail) => {
            BusError::Failed { what: "open", service, detail }
        }
    })
}

/// Maximum number of ports of one kind in a service.
pub(crate) struct PortLimit {
    /// Kind of port: "publisher", …
    pub(crate) what: &'static str,
    /// The maximum.
    pub(crate) most: usize,
}

/// Creates a port with `create`, which returns `full` if the maximum number of ports exists.
///
/// Some of these ports may belong to dead processes, and while another process removes them this one cannot. The
/// removal and the creation are therefore repeated while there are dead processes.
pub(crate) fn create_port<P, E: std::fmt::Debug + PartialEq>(
    bus: &Bus,
    name: &str,
    limit: PortLimit,
    full: E,
    create: impl Fn() -> Result<P, E>,
) -> Result<P, BusError> {
    let PortLimit { what, most } = limit;
    let started = Instant::now();
    while started.elapsed() < SETTLING_MAX {
        match create() {
            Ok(port) => return Ok(port),
            Err(cause) if cause == full => {}
            Err(cause) => return Err(BusError::failed("make a port", name)(cause)),
        }
        let (cleaned, left) = bus.clear_away_the_dead();
        if cleaned == 0 && left == 0 {
            break;
        }
        if left > 0 {
            thread::sleep(PAUSE);
        }
    }
    create().map_err(|_| BusError::Full { service: name.to_owned(), what, most })
}

fn required(schema: &str) -> Result<AttributeVerifier, String> {
    let key: AttributeKey = SCHEMA_KEY.try_into().map_err(|cause| format!("{cause:?}"))?;
    let value: AttributeValue = schema.try_into().map_err(|cause| format!("{cause:?}"))?;
    AttributeVerifier::new().require(&key, &value).map_err(|cause| format!("{cause:?}"))
}

/// The schema of an existing service, for error messages.
fn schema_of(bus: &Bus, name: &ServiceName, pattern: MessagingPattern) -> String {
    let details = ipc::Service::details(name, bus.config(), pattern);
    let Ok(Some(details)) = details else { return "unknown".to_owned() };
    schema_attribute(details.static_details.attributes()).unwrap_or("not stated".to_owned())
}

fn schema_attribute(attributes: &AttributeSet) -> Option<String> {
    let key: AttributeKey = SCHEMA_KEY.try_into().ok()?;
    attributes.key_value(&key, 0).map(ToString::to_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Name of the refusal that follows from an error.
    fn refusal_of(error: impl Into<Refusal>) -> &'static str {
        match error.into() {
            Refusal::InFlux(_) => "in flux",
            Refusal::Schema => "schema",
            Refusal::Permission => "permission",
            Refusal::Damaged => "damaged",
            Refusal::Settings(_) => "settings",
            Refusal::NodesFull => "nodes full",
            Refusal::Failed(_) => "failed",
        }
    }

    macro_rules! refusals_of {
        ($Both:ident { $Open:ident: [$($open:ident),*], $Create:ident: [$($create:ident),*] }) => {
            [
                $(refusal_of($Both::$Open($Open::$open)),)*
                $(refusal_of($Both::$Create($Create::$create)),)*
            ]
        };
    }

    #[test]
    fn only_a_difference_of_settings_is_reported_as_other_settings() {
        let topics = refusals_of!(PublishSubscribeOpenOrCreateError {
            PublishSubscribeOpenError: [
                Interrupt,
                InternalFailure,
                UnableToCreateServiceTag,
                HangsInCreation,
                VersionMismatch,
                DoesNotSupportRequestedAmountOfNodes
            ],
            PublishSubscribeCreateError: [
                Interrupt,
                InternalFailure,
                UnableToCreateServiceTag,
                ServiceConfigCouldNotBeCreated,
                UnableToGenerateUniqueServiceId,
                HangsInCreation,
                SubscriberBufferMustBeLargerThanHistorySize
            ]
        });
        let (failed, settings) = ("failed", "settings");
        assert_eq!(topics[..6], ["in flux", failed, failed, "damaged", settings, settings]);
        assert_eq!(topics[6..], ["in flux", failed, failed, failed, failed, "damaged", settings]);
        let requests = refusals_of!(RequestResponseOpenOrCreateError {
            RequestResponseOpenError: [Interrupt, InternalFailure, IncompatibleOverflowBehaviorForRequests],
            RequestResponseCreateError: [ServiceConfigCouldNotBeCreated, HangsInCreation]
        });
        assert_eq!(requests, ["in flux", failed, settings, failed, "damaged"]);
        let events = refusals_of!(EventOpenOrCreateError {
            EventOpenError: [UnableToCreateServiceTag, DoesNotSupportRequestedMaxEventId],
            EventCreateError: [Interrupt, UnableToGenerateUniqueServiceId, ServiceInCorruptedState]
        });
        assert_eq!(events, [failed, settings, "in flux", failed, "damaged"]);
    }
}
