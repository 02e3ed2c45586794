//! Parses the definitions of `clients/ros2`, so that tests compare the gateway's output with them and not with itself.

use std::collections::BTreeMap;
use std::path::Path;

/// Multiplicity of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Many {
    One,
    Array(usize),
    Bounded(usize),
    Unbounded,
}

/// A field of a definition.
#[derive(Debug, Clone)]
pub(crate) struct Field {
    pub(crate) name: String,
    /// Name of a primitive, or of a message with its package, such as `std_msgs/msg/Header`.
    pub(crate) of: String,
    pub(crate) many: Many,
}

/// Messages by full name.
pub(crate) type Definitions = BTreeMap<String, Vec<Field>>;

pub(crate) const PRIMITIVES: [(&str, u32); 7] =
    [("uint8", 3), ("int32", 6), ("uint32", 7), ("uint64", 9), ("float64", 11), ("bool", 15), ("string", 17)];

/// All messages of the package, and the messages of other packages that they use.
pub(crate) fn definitions() -> Definitions {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../clients/ros2/equipoise_msgs/msg");
    let mut all: Definitions = std::fs::read_dir(&folder)
        .unwrap_or_else(|error| panic!("{}: {error}", folder.display()))
        .map(|entry| entry.unwrap().path())
        .map(|path| {
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (
                format!("equipoise_msgs/msg/{name}"),
                fields("equipoise_msgs", &std::fs::read_to_string(&path).unwrap()),
            )
        })
        .collect();
    all.extend(of_others());
    all
}

/// From rcl_interfaces and common_interfaces.
pub(crate) fn of_others() -> Definitions {
    [
        ("builtin_interfaces", "Time", "int32 sec\nuint32 nanosec"),
        ("std_msgs", "Header", "builtin_interfaces/Time stamp\nstring frame_id"),
        ("std_msgs", "String", "string data"),
    ]
    .into_iter()
    .map(|(package, name, text)| (format!("{package}/msg/{name}"), fields(package, text)))
    .collect()
}

fn fields(package: &str, text: &str) -> Vec<Field> {
    text.lines()
        .map(|line| line.split('#').next().unwrap_or("").trim())
        .filter(|line| !line.is_empty() && !line.contains('=') || line.contains("<="))
        .map(|line| field(package, line))
        .collect()
}

fn field(package: &str, line: &str) -> Field {
    let (of, name) = line.split_once(char::is_whitespace).unwrap_or_else(|| panic!("no field: {line}"));
    let (of, many) = match of.split_once('[') {
        None => (of, Many::One),
        Some((of, "]")) => (of, Many::Unbounded),
        Some((of, count)) => {
            let count = count.strip_suffix(']').unwrap();
            match count.strip_prefix("<=") {
                Some(most) => (of, Many::Bounded(most.parse().unwrap())),
                None => (of, Many::Array(count.parse().unwrap())),
            }
        }
    };
    let of = match of.split_once('/') {
        Some((package, name)) => format!("{package}/msg/{name}"),
        None if PRIMITIVES.iter().any(|(name, _)| *name == of) => of.to_owned(),
        None => format!("{package}/msg/{of}"),
    };
    Field { name: name.trim().to_owned(), of, many }
}
