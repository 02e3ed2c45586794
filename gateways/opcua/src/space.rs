//! The address space: an object for the station, a folder of joints below it, and a variable for every row of the
//! table.

use equipoise_core::body::Joint;
use opcua::nodes::{ObjectBuilder, VariableBuilder};
use opcua::server::address_space::AddressSpace;
use opcua::types::{
    DataTypeId, EUInformation, ExtensionObject, LocalizedText, NodeId, ObjectId, ObjectTypeId, QualifiedName,
    VariableTypeId, Variant,
};

use crate::table::{Row, Type, Unit};
use crate::values::rows;

/// Namespace of the nodes. Clients look up its index by this URI; the number at its end is incremented when nodes
/// change.
pub const NAMESPACE: &str = "urn:equipoise:station:1";
/// Namespace of the unit IDs (OPC UA Part 8).
const UNITS: &str = "http://www.opcfoundation.org/UA/units/un/cefact";

/// Node ID of a row: `STATION/NAME`, or `STATION/Joints/JOINT/NAME`.
pub fn node_id(namespace: u16, station: &str, row: &Row, joint: Option<Joint>) -> NodeId {
    NodeId::new(namespace, path(station, row, joint))
}

fn path(station: &str, row: &Row, joint: Option<Joint>) -> String {
    match joint {
        None => format!("{station}/{}", row.name),
        Some(joint) => format!("{station}/Joints/{}/{}", joint.name(), row.name),
    }
}

/// Inserts the station's nodes without values; returns their IDs in the order of [`rows`].
pub fn build(space: &mut AddressSpace, namespace: u16, station: &str) -> Vec<NodeId> {
    let station_id = NodeId::new(namespace, station);
    ObjectBuilder::new(&station_id, QualifiedName::new(namespace, station), station)
        .description("The station's estimates for its worker; do not use values with a bad status")
        .has_type_definition(ObjectTypeId::BaseObjectType)
        .organized_by(ObjectId::ObjectsFolder)
        .insert(space);
    let joints_id = NodeId::new(namespace, format!("{station}/Joints"));
    ObjectBuilder::new(&joints_id, QualifiedName::new(namespace, "Joints"), "Joints")
        .is_folder()
        .component_of(station_id.clone())
        .insert(space);
    for joint in Joint::ALL {
        ObjectBuilder::new(
            &joint_id(namespace, station, joint),
            QualifiedName::new(namespace, joint.name()),
            joint.name(),
        )
        .has_type_definition(ObjectTypeId::BaseObjectType)
        .component_of(joints_id.clone())
        .insert(space);
    }
    rows()
        .map(|(row, joint)| {
            let id = node_id(namespace, station, row, joint);
            let parent =
                joint.map_or_else(|| station_id.clone(), |joint| joint_id(namespace, station, joint));
            insert_row(space, row, &id, parent);
            insert_properties(space, row, &id, &path(station, row, joint));
            id
        })
        .collect()
}

fn joint_id(namespace: u16, station: &str, joint: Joint) -> NodeId {
    NodeId::new(namespace, format!("{station}/Joints/{}", joint.name()))
}

fn insert_row(space: &mut AddressSpace, row: &Row, id: &NodeId, parent: NodeId) {
    let kind = match (row.of, row.unit) {
        (Type::State(_), _) => VariableTypeId::MultiStateDiscreteType,
        (_, Some(_)) => VariableTypeId::AnalogUnitType,
        _ => VariableTypeId::BaseDataVariableType,
    };
    let mut variable = VariableBuilder::new(id, QualifiedName::new(id.namespace, row.name), row.name)
        .description(row.meaning)
        .data_type(row.of.data_type())
        .has_type_definition(kind)
        .component_of(parent);
    variable = match row.of {
        Type::Doubles(length) => variable.value_rank(1).array_dimensions(&[length]),
        Type::Texts => variable.value_rank(1),
        _ => variable.value_rank(-1),
    };
    variable.insert(space);
}

fn insert_properties(space: &mut AddressSpace, row: &Row, id: &NodeId, path: &str) {
    let mut insert = |name, data_type, value_rank, value| {
        insert_property(space, id, (path, name), data_type, value_rank, value);
    };
    if let Some(unit) = row.unit {
        let value = Variant::from(ExtensionObject::from_message(information(&unit)));
        insert("EngineeringUnits", DataTypeId::EUInformation, -1, value);
    }
    if let Type::State(names) = row.of {
        let names: Vec<LocalizedText> = names.iter().map(|name| LocalizedText::new("en", name)).collect();
        insert("EnumStrings", DataTypeId::LocalizedText, 1, Variant::from(names));
    }
}

/// Properties have browse names of the standard's namespace; their node IDs are in this namespace.
fn insert_property(
    space: &mut AddressSpace,
    of: &NodeId,
    (path, name): (&str, &str),
    data_type: DataTypeId,
    value_rank: i32,
    value: Variant,
) {
    let id = NodeId::new(of.namespace, format!("{path}/{name}"));
    VariableBuilder::new(&id, QualifiedName::new(0, name), name)
        .data_type(data_type)
        .value_rank(value_rank)
        .has_type_definition(VariableTypeId::PropertyType)
        .property_of(of.clone())
        .value(value)
        .insert(space);
}

fn information(unit: &Unit) -> EUInformation {
    EUInformation {
        namespace_uri: UNITS.into(),
        unit_id: unit.id(),
        display_name: LocalizedText::new("en", unit.symbol),
        description: LocalizedText::new("en", unit.name),
    }
}
