//! Sensor arrangements of plates and insoles, and the channels of each.

use super::{ALL_BUT_VERTICAL, ChannelFault, Channels, ForceUnit, Form, MomentUnit, Row};
use equipoise_core::message::Component;

/// One channel for each component of a wrench about the sensor's origin; absent components are not measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Direct {
    /// Force x, y, z. The vertical component is required; x and y only as a pair.
    pub force: [Option<usize>; 3],
    /// Moment x, y, z; x and y only as a pair.
    pub moment: [Option<usize>; 3],
}

/// Four three-axis sensors under a plate, with horizontal forces summed in pairs, as in Kistler's plates (Kistler,
/// Force Plate Formulae, 3 February 1999). Axes: z down.
#[derive(Debug, Clone, PartialEq)]
pub struct EightChannels {
    /// Channels of fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4.
    pub channels: [usize; 8],
    /// Distance of the sensors from the plate's centre along x, m.
    pub a_m: f64,
    /// The same along y, m.
    pub b_m: f64,
    /// Value of one unit of each channel, N: 1 if the channels are in N already, 1000 / S for volts at a sensitivity of
    /// S mV/N.
    pub newtons_per_unit: [f64; 8],
    /// Value of each channel without load, in the channel's own unit.
    pub zero: [f64; 8],
}

/// A load cell that measures the vertical force at one point, positive in compression. Axes: z up, force on the person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// The cell's channel.
    pub channel: usize,
    /// The cell's position in the sensor's axes, m.
    pub at_m: [f64; 2],
}

/// A device that reports the centre of pressure rather than moments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Centre {
    /// Channels of the horizontal force, x and y, if it is measured.
    pub shear: Option<[usize; 2]>,
    /// Channel of the vertical force.
    pub vertical: usize,
    /// Channels of the centre of pressure, x and y, on the walking surface.
    pub cop: [usize; 2],
    /// Channel of the moment about the vertical through the centre of pressure, if it is measured.
    pub free_moment: Option<usize>,
    /// Height of the walking surface along the sensor's z, m: negative where z points down.
    pub surface_z_m: f64,
    /// Value of one unit of the force channels, N.
    pub newtons_per_unit: f64,
    /// Value of one unit of the free moment's channel, N m.
    pub newton_metres_per_unit: f64,
    /// Value of one unit of the centre's channels, m.
    pub metres_per_unit: f64,
}

/// An insole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Insole {
    /// Channel of the force on the foot.
    pub vertical: usize,
    /// Channels of the centre of pressure: toward the toes, to the left.
    pub cop: [usize; 2],
    /// Value of one unit of the force channel, N.
    pub newtons_per_unit: f64,
    /// Value of one unit of each centre channel, m, from the middle of the sole; negative for the opposite direction.
    pub metres_per_unit: [f64; 2],
}

impl Channels {
    /// Channels that are the components of the wrench themselves.
    ///
    /// # Errors
    /// [`ChannelFault::Beyond`], or [`ChannelFault::Half`] of a pair.
    pub fn direct(
        count: usize,
        direct: Direct,
        force: ForceUnit,
        moment: MomentUnit,
    ) -> Result<Channels, ChannelFault> {
        let Direct { force: [fx, fy, fz], moment: [mx, my, mz] } = direct;
        if fz.is_none() {
            return Err(ChannelFault::Half { what: "the horizontal and the vertical force" });
        }
        let mut not_measured = 0;
        for (pair, component, what) in [
            ([fx, fy], Component::Shear, "the horizontal force, fx and fy"),
            ([mx, my], Component::Tilt, "the moment about the horizontal axes, mx and my"),
            ([mz, mz], Component::FreeMoment, "the moment about the vertical"),
        ] {
            match pair {
                [None, None] => not_measured |= component as u32,
                [Some(_), Some(_)] => {}
                _ => return Err(ChannelFault::Half { what }),
            }
        }
        let row = |channel: Option<usize>, unit| Row {
            terms: channel.map(|channel| (channel, 1.0)).into_iter().collect(),
            unit,
        };
        let (n, nm) = (force.newtons(), moment.newton_metres());
        let rows = [row(fx, n), row(fy, n), row(fz, n), row(mx, nm), row(my, nm), row(mz, nm)];
        Channels::linear(count, rows, Vec::new(), not_measured)
    }

    /// Channels that a 6×n matrix converts to force x, y, z and moment x, y, z about the sensor's origin; `zero`
    /// (empty, or one number for each channel) holds their values without load.
    ///
    /// # Errors
    /// [`ChannelFault::Row`] or [`ChannelFault::Number`].
    pub fn matrix(
        rows: &[Vec<f64>; 6],
        zero: &[f64],
        force: ForceUnit,
        moment: MomentUnit,
    ) -> Result<Channels, ChannelFault> {
        let want = rows[0].len();
        if !zero.is_empty() && zero.len() != want {
            return Err(ChannelFault::Row { row: 0, got: zero.len(), want });
        }
        for (index, row) in rows.iter().enumerate() {
            if row.is_empty() || row.len() != want {
                return Err(ChannelFault::Row { row: index + 1, got: row.len(), want });
            }
        }
        let unit = |row| if row < 3 { force.newtons() } else { moment.newton_metres() };
        let rows = core::array::from_fn(|row| Row {
            terms: rows[row].iter().copied().enumerate().collect(),
            unit: unit(row),
        });
        Channels::linear(want, rows, zero.to_vec(), 0)
    }

    /// The eight channels of a plate with four three-axis sensors.
    ///
    /// # Errors
    /// [`ChannelFault::Beyond`] or [`ChannelFault::Number`].
    pub fn eight(count: usize, eight: &EightChannels) -> Result<Channels, ChannelFault> {
        let EightChannels { channels, a_m: a, b_m: b, newtons_per_unit, zero } = eight;
        if !(*a > 0.0 && *b > 0.0) {
            return Err(ChannelFault::Number { what: "a and b, the places of the sensors," });
        }
        if newtons_per_unit.contains(&0.0) {
            return Err(ChannelFault::Number { what: "the sensitivity of each channel" });
        }
        let row = |weights: &[(usize, f64)]| Row {
            terms: weights
                .iter()
                .map(|(which, weight)| (channels[*which], weight * newtons_per_unit[*which]))
                .collect(),
            unit: 1.0,
        };
        let [fx12, fx34, fy14, fy23, fz1, fz2, fz3, fz4]: [usize; 8] = core::array::from_fn(|which| which);
        let rows = [
            row(&[(fx12, 1.0), (fx34, 1.0)]),
            row(&[(fy14, 1.0), (fy23, 1.0)]),
            row(&[(fz1, 1.0), (fz2, 1.0), (fz3, 1.0), (fz4, 1.0)]),
            row(&[(fz1, *b), (fz2, *b), (fz3, -b), (fz4, -b)]),
            row(&[(fz1, -a), (fz2, *a), (fz3, *a), (fz4, -a)]),
            row(&[(fx12, -b), (fx34, *b), (fy14, *a), (fy23, -a)]),
        ];
        let mut zeros = vec![0.0; count];
        for (channel, zero) in channels.iter().zip(zero) {
            *zeros.get_mut(*channel).ok_or(ChannelFault::Beyond { channel: *channel, count })? = *zero;
        }
        Channels::linear(count, rows, zeros, 0)
    }

    /// Load cells under a plate: they measure the vertical force and its point of action, but no shear.
    ///
    /// # Errors
    /// [`ChannelFault::Cells`], [`ChannelFault::Beyond`] or [`ChannelFault::Number`].
    pub fn cells(count: usize, cells: &[Cell], force: ForceUnit) -> Result<Channels, ChannelFault> {
        let area = |a: &Cell, b: &Cell, c: &Cell| {
            let side = |to: &Cell| [to.at_m[0] - a.at_m[0], to.at_m[1] - a.at_m[1]];
            let (u, v) = (side(b), side(c));
            (u[0] * v[1] - u[1] * v[0]).abs()
        };
        let carries = cells
            .iter()
            .any(|c| matches!(cells, [a, rest @ ..] if rest.iter().any(|b| area(a, b, c) > 1e-6)));
        if !carries {
            return Err(ChannelFault::Cells);
        }
        let row = |weight: &dyn Fn(&Cell) -> f64| Row {
            terms: cells.iter().map(|cell| (cell.channel, weight(cell))).collect(),
            unit: force.newtons(),
        };
        let none = Row::default;
        let rows =
            [none(), none(), row(&|_| 1.0), row(&|cell| cell.at_m[1]), row(&|cell| -cell.at_m[0]), none()];
        Channels::linear(count, rows, Vec::new(), Component::Shear as u32 | Component::FreeMoment as u32)
    }

    /// A device that reports the point of action of the force.
    ///
    /// # Errors
    /// [`ChannelFault::Beyond`] or [`ChannelFault::Number`].
    pub fn centre(count: usize, centre: Centre) -> Result<Channels, ChannelFault> {
        let Centre { shear, vertical, cop, free_moment, surface_z_m, .. } = centre;
        within(shear.iter().flatten().chain(&cop).chain([&vertical]).chain(&free_moment), count)?;
        let units = [centre.newtons_per_unit, centre.newton_metres_per_unit, centre.metres_per_unit];
        if units.contains(&0.0) || !units.iter().chain([&surface_z_m]).all(|x| x.is_finite()) {
            return Err(ChannelFault::Number { what: "every unit" });
        }
        let missing = |there: bool, component| if there { 0 } else { component as u32 };
        let not_measured = missing(shear.is_some(), Component::Shear)
            | missing(free_moment.is_some(), Component::FreeMoment);
        Ok(Channels { count, form: Form::Centre { centre, not_measured } })
    }

    /// Insoles, left and right.
    ///
    /// # Errors
    /// [`ChannelFault::Beyond`] or [`ChannelFault::Number`].
    pub fn insoles(count: usize, insoles: [Insole; 2]) -> Result<Channels, ChannelFault> {
        within(insoles.iter().flat_map(|insole| insole.cop.iter().chain([&insole.vertical])), count)?;
        let mut units =
            insoles.iter().flat_map(|insole| insole.metres_per_unit.iter().chain([&insole.newtons_per_unit]));
        if !units.all(|unit| unit.is_finite() && *unit != 0.0) {
            return Err(ChannelFault::Number { what: "length and width of the insoles" });
        }
        Ok(Channels { count, form: Form::Insoles(insoles) })
    }

    fn linear(
        count: usize,
        rows: [Row; 6],
        zero: Vec<f64>,
        not_measured: u32,
    ) -> Result<Channels, ChannelFault> {
        debug_assert_eq!(not_measured & !ALL_BUT_VERTICAL, 0);
        within(rows.iter().flat_map(|row| &row.terms).map(|(channel, _)| channel), count)?;
        let mut weights = rows.iter().flat_map(|row| &row.terms).map(|(_, weight)| weight).chain(&zero);
        if !weights.all(|weight| weight.is_finite()) {
            return Err(ChannelFault::Number { what: "every number of the channels' calibration" });
        }
        Ok(Channels { count, form: Form::Linear { rows, zero, not_measured } })
    }
}

fn within<'a>(channels: impl IntoIterator<Item = &'a usize>, count: usize) -> Result<(), ChannelFault> {
    match channels.into_iter().find(|channel| **channel >= count) {
        Some(channel) => Err(ChannelFault::Beyond { channel: *channel, count }),
        None => Ok(()),
    }
}
