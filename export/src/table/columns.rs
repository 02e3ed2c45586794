//! Columns of a message, derived from its field table, and conversion of a message to a row.

use equipoise_core::message::layout::{Field, Primitive};

use super::names;
use super::rules::Exported;

/// Type of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Floating-point numbers of 64 bits.
    F64,
    /// Unsigned integers of 64 bits.
    U64,
    /// Unsigned integers of 32 bits.
    U32,
    /// Text.
    Text,
}

/// One column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// Column name.
    pub name: String,
    /// Unit, if the name contains one.
    pub unit: Option<&'static str>,
    /// Type of the values.
    pub kind: Kind,
    source: ColumnSource,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum ColumnSource {
    /// Seconds since the start of the recording.
    Time,
    /// Index into the message's texts.
    Text(usize),
    /// An element of a field.
    Number { field: Field, index: usize },
}

/// One value of a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// As [`Kind::F64`]; finite.
    F64(f64),
    /// As [`Kind::U64`].
    U64(u64),
    /// As [`Kind::U32`].
    U32(u32),
    /// As [`Kind::Text`].
    Text(String),
}

/// Values of one message in the order of its columns; `None` for invalid values.
#[derive(Debug, Clone, PartialEq)]
pub struct Row(pub Vec<Option<Value>>);

/// Columns of a message: `t_s`, its texts, then every field except reserved ones.
pub fn columns<M: Exported>() -> Vec<Column> {
    let time =
        Column { name: "t_s".to_owned(), unit: Some("s"), kind: Kind::F64, source: ColumnSource::Time };
    let texts = M::TEXTS.iter().enumerate().map(|(index, name)| Column {
        name: (*name).to_owned(),
        unit: None,
        kind: Kind::Text,
        source: ColumnSource::Text(index),
    });
    let fields = M::FIELDS.iter().filter(|field| !field.name.starts_with("reserved"));
    let numbers = fields.flat_map(|field| {
        (0..field.count).map(|index| Column {
            name: names::column(field, index),
            unit: names::unit(field.name),
            kind: match field.primitive {
                Primitive::F64 => Kind::F64,
                Primitive::U64 => Kind::U64,
                Primitive::U32 | Primitive::U8 => Kind::U32,
            },
            source: ColumnSource::Number { field: *field, index },
        })
    });
    [time].into_iter().chain(texts).chain(numbers).collect()
}

impl Row {
    /// Converts a message to a row; its time counts from `started_ns`.
    pub fn of<M: Exported>(message: &M, columns: &[Column], started_ns: u64) -> Row {
        let (bytes, texts) = (bytemuck::bytes_of(message), message.texts());
        let value = |column: &Column| match column.source {
            ColumnSource::Time => {
                let since_ns = i128::from(message.row_time_ns()) - i128::from(started_ns);
                // Dividing by 1e9 rounds correctly, multiplying by 1e-9 does not: 34 ms yields 0.034.
                Some(Value::F64(since_ns as f64 / 1e9))
            }
            ColumnSource::Text(index) => texts.get(index).cloned().map(Value::Text),
            ColumnSource::Number { field, index } if message.is_available(field.name, index) => {
                number(bytes, field, index)
            }
            ColumnSource::Number { .. } => None,
        };
        Row(columns.iter().map(value).collect())
    }
}

/// Reads one element of a field; `None` if it is not finite.
fn number(bytes: &[u8], field: Field, index: usize) -> Option<Value> {
    let bytes = bytes.get(field.offset + index * field.primitive.size()..)?;
    Some(match field.primitive {
        Primitive::F64 => {
            Value::F64(Some(f64::from_ne_bytes(*bytes.first_chunk()?)).filter(|v| v.is_finite())?)
        }
        Primitive::U64 => Value::U64(u64::from_ne_bytes(*bytes.first_chunk()?)),
        Primitive::U32 => Value::U32(u32::from_ne_bytes(*bytes.first_chunk()?)),
        Primitive::U8 => Value::U32(u32::from(*bytes.first()?)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::{CycleRecord, GroundSample, State, SuitSample, Validity};
    use std::collections::BTreeSet;

    fn names_of<M: Exported>() -> Vec<String> {
        columns::<M>().into_iter().map(|column| column.name).collect()
    }

    #[test]
    fn every_number_has_a_name_of_its_own() {
        for names in [
            names_of::<State>(),
            names_of::<SuitSample>(),
            names_of::<GroundSample>(),
            names_of::<CycleRecord>(),
        ] {
            assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len());
            let nameless: Vec<_> = names
                .iter()
                .filter(|name| !name.starts_with("command_argument"))
                .filter(|name| name.rsplit('_').next().is_some_and(|end| end.parse::<u32>().is_ok()))
                .collect();
            assert!(nameless.is_empty(), "{nameless:?}");
        }
        for name in [
            "t_s",
            "torque_nm_RightKnee_y",
            "torque_covariance_nm2_RightKnee_xy",
            "fatigue_L5S1",
            "segment_origin_m_Pelvis_z",
            "foot_load_fraction_left",
            "com_m_x",
        ] {
            assert!(names_of::<State>().iter().any(|column| column == name), "{name}");
        }
    }

    #[test]
    fn every_field_with_a_point_has_a_unit_or_is_known_to_have_none() {
        let pure = [
            "foot_load_fraction",
            "hand_load_fraction",
            "nis",
            "prior_inflation",
            "dose",
            "fatigue",
            "command_argument",
        ];
        let all = [
            columns::<State>(),
            columns::<SuitSample>(),
            columns::<GroundSample>(),
            columns::<CycleRecord>(),
        ];
        for column in all.iter().flatten().filter(|column| column.kind == Kind::F64 && column.unit.is_none())
        {
            assert!(pure.iter().any(|name| column.name.starts_with(name)), "{} has no unit", column.name);
        }
    }

    #[test]
    fn a_row_has_the_message_s_numbers_and_withholds_what_must_not_be_used() {
        let (columns, mut state) = (columns::<State>(), State::zeroed());
        (state.time_ns, state.cop_measured_m) = (1_034_000_000, [0.25, f64::NAN]);
        state.torque_nm[0] = [1.0, 2.0, 3.0];
        let of = |state: &State, name: &str| {
            let at = columns.iter().position(|column| column.name == name).unwrap();
            Row::of(state, &columns, 1_000_000_000).0[at].clone()
        };
        assert_eq!(of(&state, "t_s"), Some(Value::F64(0.034)));
        assert_eq!(of(&state, "torque_nm_L5S1_y"), Some(Value::F64(2.0)));
        assert_eq!(of(&state, "cop_measured_m_x"), Some(Value::F64(0.25)));
        assert_eq!(of(&state, "cop_measured_m_y"), None, "what is no number is none");
        state.valid = Validity::GROUND_STALE.0;
        assert_eq!(of(&state, "cop_measured_m_x"), None);
        assert_eq!(of(&state, "torque_nm_L5S1_y"), None);
        assert_eq!(of(&state, "valid_names"), Some(Value::Text("ground_stale".to_owned())));
        assert_eq!(of(&state, "lifts"), Some(Value::U32(0)), "sums are always published");
    }
}
