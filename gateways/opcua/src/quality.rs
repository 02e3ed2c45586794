//! Status codes for missing values.

use equipoise_client::NoReading;
use equipoise_core::message::Validity;
use opcua::types::StatusCode;

/// Status of an invalid value: that of the most severe group among its raised validity flags.
pub fn of_withheld(raised: Validity) -> StatusCode {
    GROUPS
        .iter()
        .find(|(reasons, _)| raised.any_of(*reasons))
        .map_or(StatusCode::BadNoData, |(_, code)| *code)
}

/// Status of all values while there is no state; `ever`: whether there was one since the server started.
pub fn of_no_reading(reason: &NoReading, ever: bool) -> StatusCode {
    match reason {
        NoReading::OtherClock { .. } => StatusCode::BadInvalidTimestamp,
        NoReading::Stale { .. } => StatusCode::BadTimeout,
        NoReading::Silent { .. } | NoReading::Bus(_) if ever => StatusCode::BadNoCommunication,
        NoReading::Silent { .. } | NoReading::Bus(_) => StatusCode::BadWaitingForInitialData,
    }
}

/// Most severe first: sensor faults that need a technician, conditions that end with time, conditions caused by the
/// worker, no load.
const GROUPS: [(Validity, StatusCode); 4] = [
    (
        Validity::PLATE_FAULT
            .and(Validity::SUIT_STALE)
            .and(Validity::GROUND_STALE)
            .and(Validity::GROUND_IMPLAUSIBLE)
            .and(Validity::SUIT_IMPLAUSIBLE),
        StatusCode::BadSensorFailure,
    ),
    (
        Validity::CLOCK_UNSYNCHRONISED
            .and(Validity::BODY_UNKNOWN)
            .and(Validity::MASS_UNKNOWN)
            .and(Validity::NOT_IDENTIFIED)
            .and(Validity::POSITION_UNKNOWN)
            .and(Validity::MODEL_CHANGED),
        StatusCode::BadWaitingForInitialData,
    ),
    (
        Validity::MOVING
            .and(Validity::FEET_OFF_PLATE)
            .and(Validity::LOAD_NOT_AT_HANDS)
            .and(Validity::LOAD_BELOW_DETECTION_LIMIT)
            .and(Validity::WEIGHT_MISSING)
            .and(Validity::COP_NOT_MEASURED),
        StatusCode::BadInvalidState,
    ),
    (Validity::BELOW_LOAD_THRESHOLD, StatusCode::BadNoData),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_reason_is_in_one_group() {
        for (reason, name) in Validity::NAMES {
            let found = GROUPS.iter().filter(|(reasons, _)| reasons.any_of(*reason)).count();
            assert_eq!(found, 1, "{name}");
            assert!(of_withheld(*reason).is_bad(), "{name}");
        }
    }

    #[test]
    fn a_broken_sensor_outweighs_that_nothing_is_carried() {
        let both = Validity::PLATE_FAULT.and(Validity::BELOW_LOAD_THRESHOLD);
        assert_eq!(of_withheld(both), StatusCode::BadSensorFailure);
    }
}
