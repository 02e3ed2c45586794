//! `[ground.channels.…]`: meaning of a device's numbers, for devices with a configurable format.
//!
//! Exactly one of the sections below is required. Channels have the names of `[ground.text]` and `[ground.binary]`.

mod names;
mod soles;
mod units;

pub(super) use names::Names;
pub(super) use soles::size as insole_size;
pub use soles::{CopUnit, InsolesConfig, TowardsX, TowardsY};
pub use units::{ForceConfig, LengthConfig, MomentConfig};

use std::ops::RangeInclusive;

use equipoise_adapters::ground::Channels;
use equipoise_adapters::ground::channels::{Cell, Centre, ChannelFault, Direct, EightChannels};
use serde::{Deserialize, Serialize};

use super::description_error::DescriptionError;
use super::numbers::{SUMMANDS, is_summand};
use super::{Axes, GroundConfig, Measures, z_down};

/// `[ground.channels.…]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ChannelsConfig {
    /// Each channel is a force or a moment.
    Wrench(WrenchConfig),
    /// Six rows of weights convert the channels to forces and moments.
    Matrix(MatrixConfig),
    /// Four three-axis sensors with eight channels, as in Kistler's plates.
    Kistler(KistlerConfig),
    /// Load cells under a plate, each with its position.
    Cells(CellsConfig),
    /// Forces and the centre of pressure.
    Centre(CentreConfig),
    /// A pair of insoles.
    #[serde(alias = "soles")]
    Insoles(InsolesConfig),
}

/// `[ground.channels.wrench]`: channels `fx`, `fy`, `fz`, `mx`, `my`, `mz`; `fz` is required, missing ones are not
/// measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WrenchConfig {
    /// Unit of the forces.
    pub force: ForceConfig,
    /// Unit of the moments; required if there are moments.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<MomentConfig>,
}

/// `[ground.channels.matrix]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MatrixConfig {
    /// Unit of the results of the first three rows.
    pub force: ForceConfig,
    /// Unit of the results of the other rows.
    pub moment: MomentConfig,
    /// The channels, one for each column of the matrix.
    pub channels: Vec<String>,
    /// Rows Fx, Fy, Fz, Mx, My, Mz.
    pub rows: [Vec<f64>; 6],
    /// Reading of each channel without load, which is subtracted first. Zero by default.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub zero: Vec<f64>,
}

/// `[ground.channels.kistler]`: channels `fx12`, `fx34`, `fy14`, `fy23`, `fz1`, `fz2`, `fz3`, `fz4`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KistlerConfig {
    /// Unit of the channels.
    pub unit: KistlerUnit,
    /// Sensitivity of each channel in the order above, mV/N, if the unit is a voltage.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensitivity_mv_per_n: Option<[f64; 8]>,
    /// Distance of the sensors from the middle along x, m: `a` of the plate's sheet.
    pub a_m: f64,
    /// Distance along y, m: `b` of the plate's sheet.
    pub b_m: f64,
    /// Reading of each channel without load, in its unit. Zero by default.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zero: Option<[f64; 8]>,
}

/// Unit of an amplifier's channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum KistlerUnit {
    /// Volts.
    V,
    /// Millivolts.
    #[serde(rename = "mV")]
    Millivolt,
    /// Newtons: already divided by the sensitivity.
    N,
}

/// `[ground.channels.cells]`
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellsConfig {
    /// Unit of the cells, positive when pressed.
    pub force: ForceConfig,
    /// The cells.
    pub cells: Vec<toml::Spanned<CellConfig>>,
}

/// One load cell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CellConfig {
    /// Its channel.
    pub channel: String,
    /// Position in the plate's axes, m.
    pub x_m: f64,
    /// As above.
    pub y_m: f64,
}

/// `[ground.channels.centre]`: channels `fz`, `cop_x`, `cop_y`, and optionally `fx`, `fy`, `free_moment`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CentreConfig {
    /// Unit of the forces.
    pub force: ForceConfig,
    /// Unit of the centre of pressure.
    pub length: LengthConfig,
    /// Unit of the free moment; required if it is a channel.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment: Option<MomentConfig>,
}

const SECTION: &str = "ground.channels";
/// Distances of a plate's sensors from its middle, m: numbers in millimetres are outside.
const SENSOR_DISTANCES_M: RangeInclusive<f64> = 0.01..=2.0;

/// Converts the section to the adapter's channels.
pub(super) fn channels(ground: &GroundConfig, names: &mut Names<'_>) -> Result<Channels, DescriptionError> {
    let Some(config) = &ground.channels else {
        return Err(DescriptionError::new(
            SECTION,
            "must be given: [ground.channels.wrench], .matrix, .kistler, .cells, .centre or .insoles defines what the numbers measure",
        ));
    };
    match config {
        ChannelsConfig::Wrench(config) => wrench(config, names),
        ChannelsConfig::Matrix(config) => matrix(config, names),
        ChannelsConfig::Kistler(config) => kistler(config, ground, names),
        ChannelsConfig::Cells(config) => cells(config, ground, names),
        ChannelsConfig::Centre(config) => centre(config, ground, names),
        ChannelsConfig::Insoles(config) => soles::channels(config, names),
    }
}

fn fault(section: &'static str) -> impl Fn(ChannelFault) -> DescriptionError {
    move |fault| DescriptionError::new(format!("{SECTION}.{section}"), fault.to_string())
}

fn moment(config: Option<MomentConfig>, key: &str) -> Result<MomentConfig, DescriptionError> {
    config.ok_or_else(|| {
        DescriptionError::new(
            key,
            "must be given where moments are: \"N m\", \"N mm\", \"kN m\", \"lbf in\" or \"lbf ft\"",
        )
    })
}

fn wrench(config: &WrenchConfig, names: &mut Names<'_>) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.wrench";
    let direct = Direct {
        force: [names.lookup("fx"), names.lookup("fy"), Some(names.find("fz", key)?)],
        moment: ["mx", "my", "mz"].map(|name| names.lookup(name)),
    };
    let unit = match config.moment {
        None if direct.moment == [None; 3] => MomentConfig::NewtonMetre,
        unit => moment(unit, "ground.channels.wrench.moment")?,
    };
    Channels::direct(names.count(), direct, config.force.into(), unit.into()).map_err(fault("wrench"))
}

fn matrix(config: &MatrixConfig, names: &mut Names<'_>) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.matrix.channels";
    let columns = config.channels.iter().map(|name| names.find(name, key)).collect::<Result<Vec<_>, _>>()?;
    if let Some(twice) = (1..columns.len()).find(|column| columns[..*column].contains(&columns[*column])) {
        let what = format!("channel `{}` is named twice", config.channels[twice]);
        return Err(DescriptionError::new(key, what));
    }
    if !config.zero.is_empty() && config.zero.len() != columns.len() {
        let what = format!("{} numbers, and there are {} channels", config.zero.len(), columns.len());
        return Err(DescriptionError::new("ground.channels.matrix.zero", what));
    }
    // The device lists its channels in its own order.
    let spread = |numbers: &[f64]| {
        let mut all = vec![0.0; names.count()];
        for (column, number) in columns.iter().zip(numbers) {
            all[*column] = *number;
        }
        all
    };
    for (index, row) in config.rows.iter().enumerate() {
        if row.len() != columns.len() {
            let fault = ChannelFault::Row { row: index + 1, got: row.len(), want: columns.len() };
            return Err(DescriptionError::new("ground.channels.matrix.rows", fault.to_string()));
        }
    }
    let numbers = config.rows.iter().flatten().chain(&config.zero);
    if let Some(number) = numbers.copied().find(|number| !is_summand(*number)) {
        return Err(DescriptionError::new("ground.channels.matrix", format!("{number:?} is not {SUMMANDS}")));
    }
    let rows = config.rows.each_ref().map(|row| spread(row));
    let channels = Channels::matrix(&rows, &spread(&config.zero), config.force.into(), config.moment.into());
    channels.map_err(fault("matrix"))
}

fn kistler(
    config: &KistlerConfig,
    ground: &GroundConfig,
    names: &mut Names<'_>,
) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.kistler";
    z_down::check_kistler(ground)?;
    for (name, metres) in [("a_m", config.a_m), ("b_m", config.b_m)] {
        if !SENSOR_DISTANCES_M.contains(&metres) {
            let what = format!("{metres} must be 0.01 to 2 m; enter the data sheet's a and b in metres");
            return Err(DescriptionError::new(format!("ground.channels.kistler.{name}"), what));
        }
    }
    let mut find = |name| names.find(name, key);
    let channels = [
        find("fx12")?,
        find("fx34")?,
        find("fy14")?,
        find("fy23")?,
        find("fz1")?,
        find("fz2")?,
        find("fz3")?,
        find("fz4")?,
    ];
    let newtons_per_unit = match (config.unit, config.sensitivity_mv_per_n) {
        (KistlerUnit::N, None) => [1.0; 8],
        (KistlerUnit::V, Some(sensitivity)) => sensitivity.map(|mv_per_n| 1000.0 / mv_per_n),
        (KistlerUnit::Millivolt, Some(sensitivity)) => sensitivity.map(|mv_per_n| 1.0 / mv_per_n),
        (KistlerUnit::N, Some(_)) => {
            return Err(DescriptionError::new(
                "ground.channels.kistler.sensitivity_mv_per_n",
                "newtons have no sensitivity; is the unit \"V\"?",
            ));
        }
        (_, None) => {
            return Err(DescriptionError::new(
                "ground.channels.kistler.sensitivity_mv_per_n",
                "must be given for volts: eight numbers of the plate's sheet",
            ));
        }
    };
    let eight = EightChannels {
        channels,
        a_m: config.a_m,
        b_m: config.b_m,
        newtons_per_unit,
        zero: config.zero.unwrap_or_default(),
    };
    Channels::eight(names.count(), &eight).map_err(fault("kistler"))
}

fn cells(
    config: &CellsConfig,
    ground: &GroundConfig,
    names: &mut Names<'_>,
) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.cells.cells";
    if ground.frame.axes != Axes::ZUp || ground.measures != Measures::Reaction {
        return Err(DescriptionError::new(
            "ground.measures",
            "must be \"reaction\" for load cells, which read positive when pressed, and ground.frame.axes \"z-up\"",
        ));
    }
    let mut found: Vec<Cell> = Vec::new();
    for entry in &config.cells {
        let CellConfig { channel, x_m, y_m } = entry.get_ref();
        if !(x_m.abs() <= 5.0 && y_m.abs() <= 5.0) {
            return Err(DescriptionError::at(
                entry,
                key,
                "a place is given in metres from the plate's origin",
            ));
        }
        let index = names
            .find(channel, key)
            .map_err(|error| DescriptionError { span: Some(entry.span()), ..error })?;
        if found.iter().any(|cell| cell.channel == index) {
            return Err(DescriptionError::at(entry, key, format!("`{channel}` is the channel of two cells")));
        }
        found.push(Cell { channel: index, at_m: [*x_m, *y_m] });
    }
    Channels::cells(names.count(), &found, config.force.into()).map_err(fault("cells"))
}

fn centre(
    config: &CentreConfig,
    ground: &GroundConfig,
    names: &mut Names<'_>,
) -> Result<Channels, DescriptionError> {
    let key = "ground.channels.centre";
    let (fx, fy) = (names.lookup("fx"), names.lookup("fy"));
    let shear = match (fx, fy) {
        (Some(fx), Some(fy)) => Some([fx, fy]),
        (None, None) => None,
        _ => {
            return Err(DescriptionError::new(
                key,
                "fx without fy, or the other way round, says nothing; name both or neither",
            ));
        }
    };
    let free_moment = names.lookup("free_moment");
    let unit = if free_moment.is_none() {
        MomentConfig::NewtonMetre
    } else {
        moment(config.moment, "ground.channels.centre.moment")?
    };
    let height_m = ground.frame.surface_height_m;
    let centre = Centre {
        shear,
        vertical: names.find("fz", key)?,
        cop: [names.find("cop_x", key)?, names.find("cop_y", key)?],
        free_moment,
        surface_z_m: if ground.frame.axes == Axes::ZUp { height_m } else { -height_m },
        newtons_per_unit: config.force.newtons(),
        newton_metres_per_unit: unit.newton_metres(),
        metres_per_unit: config.length.metres(),
    };
    Channels::centre(names.count(), centre).map_err(fault("centre"))
}
