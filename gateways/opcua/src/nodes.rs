//! Node manager for the library: nodes in memory, read only; every new value is passed to the subscribed items.
//!
//! If two values both have a SourceTimestamp, the library delays the later one when its sampling interval requires it
//! or when its time is the earlier one; it then publishes it with a time of its own, even after a bad status that
//! arrived in between. A value without a SourceTimestamp passes at once. Therefore subscribers receive a
//! SourceTimestamp only where the library delays nothing: for items that were created with an interval (it is revised
//! to "none") and never modified, and as long as the time does not run backwards.

use std::collections::{BTreeSet, HashSet};
use std::sync::{Mutex, PoisonError};

use opcua::server::address_space::AddressSpace;
use opcua::server::address_space::NodeType;
use opcua::server::diagnostics::NamespaceMetadata;
use opcua::server::node_manager::memory::{
    InMemoryNodeManager, InMemoryNodeManagerBuilder, InMemoryNodeManagerImpl,
};
use opcua::server::node_manager::{MonitoredItemRef, MonitoredItemUpdateRef};
use opcua::server::node_manager::{NodeManagerBuilder, RequestContext, ServerContext};
use opcua::server::{CreateMonitoredItem, MonitoredItemHandle, SubscriptionCache};
use opcua::sync::RwLock;
use opcua::types::{AttributeId, DataValue, DateTime, NodeId, StatusCode, TimestampsToReturn};

use crate::space::NAMESPACE;

/// Node manager of this namespace.
pub type StationNodeManager = InMemoryNodeManager<Nodes>;

/// Shorter than any period, but not zero, which the library treats as "not specified".
const EVERY_BEAT_MS: f64 = 1e-4;

/// Overrides of the library's default node manager.
pub struct Nodes {
    namespace: NamespaceMetadata,
    /// Items whose values the library never delays, so that they may have a SourceTimestamp.
    timed: Mutex<HashSet<MonitoredItemHandle>>,
    /// IDs of the sessions that have created items.
    sessions: Mutex<BTreeSet<u32>>,
}

/// The newest SourceTimestamp that was sent to subscribers of a node.
#[derive(Debug, Clone, Copy, Default)]
pub struct Newest(Option<DateTime>);

impl Newest {
    /// Whether a value may keep its SourceTimestamp: not if it runs backwards, as after the wall clock was set back.
    pub fn may_have_time(&mut self, value: &DataValue) -> bool {
        let is_later = value.source_timestamp >= self.0;
        if is_later {
            self.0 = value.source_timestamp;
        }
        is_later
    }
}

/// The value without its SourceTimestamp.
fn without_time(mut value: DataValue) -> DataValue {
    (value.source_timestamp, value.source_picoseconds) = (None, None);
    value
}

/// Updates the nodes and notifies subscribers; returns the number of items in the library, including those of ended
/// sessions.
///
/// # Errors
/// A node does not exist.
pub fn renew(
    node_manager: &StationNodeManager,
    subscriptions: &SubscriptionCache,
    nodes: &[NodeId],
    newest: &mut [Newest],
    values: Vec<DataValue>,
) -> Result<usize, StatusCode> {
    {
        let mut space = node_manager.address_space().write();
        for (node, value) in nodes.iter().zip(&values) {
            match space.find_mut(node) {
                Some(NodeType::Variable(variable)) => variable.set_data_value(value.clone()),
                _ => return Err(StatusCode::BadNodeIdUnknown),
            }
        }
    }
    let timed = node_manager.inner().timed();
    let mut items = 0;
    let mut notifier = subscriptions.data_notifier();
    for ((node, newest), value) in nodes.iter().zip(newest).zip(values) {
        let may_have_time = newest.may_have_time(&value);
        let Some(mut batch) = notifier.notify_for(node, AttributeId::Value) else { continue };
        for (item, _) in batch.entries() {
            items += 1;
            let value = value.clone();
            let is_whole = may_have_time && timed.contains(item);
            batch.data_value_to_item(if is_whole { value } else { without_time(value) }, item);
        }
    }
    Ok(items)
}

impl Nodes {
    fn timed(&self) -> std::sync::MutexGuard<'_, HashSet<MonitoredItemHandle>> {
        self.timed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// IDs of the sessions that have created items.
    pub fn sessions(&self) -> std::sync::MutexGuard<'_, BTreeSet<u32>> {
        self.sessions.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Creates the node manager, without nodes.
pub fn node_manager_builder() -> impl NodeManagerBuilder {
    InMemoryNodeManagerBuilder::new(|context: ServerContext, space: &mut AddressSpace| {
        let index = context.type_tree.write().namespaces_mut().add_namespace(NAMESPACE);
        space.add_namespace(NAMESPACE, index);
        let namespace = NamespaceMetadata {
            namespace_uri: NAMESPACE.to_owned(),
            namespace_index: index,
            ..NamespaceMetadata::default()
        };
        Nodes { namespace, timed: Mutex::default(), sessions: Mutex::default() }
    })
}

#[async_trait::async_trait]
impl InMemoryNodeManagerImpl for Nodes {
    async fn init(&self, _: &mut AddressSpace, _: ServerContext) {}

    fn name(&self) -> &str {
        "station"
    }

    fn namespaces(&self) -> Vec<NamespaceMetadata> {
        vec![self.namespace.clone()]
    }

    /// Revises the sampling interval to "none": every tick is a sample. An interval equal to the subscription's own
    /// (−1) cannot be revised.
    async fn create_value_monitored_items(
        &self,
        context: &RequestContext,
        space: &RwLock<AddressSpace>,
        items: &mut [&mut &mut CreateMonitoredItem],
    ) {
        self.sessions().insert(context.session_id);
        let space = space.read();
        for item in items {
            item.revise_sampling_interval(EVERY_BEAT_MS);
            let is_timed = (0.0..=EVERY_BEAT_MS).contains(&item.sampling_interval());
            let value = space.read(context, item.item_to_monitor(), 0.0, TimestampsToReturn::Both);
            if value.status() != StatusCode::BadAttributeIdInvalid {
                item.set_initial_value(if is_timed { value } else { without_time(value) });
            }
            if is_timed {
                self.timed().insert(item.handle());
            }
            item.set_status(StatusCode::Good);
        }
    }

    /// The library has accepted the requested interval unrevised, so these items lose their SourceTimestamp.
    async fn modify_monitored_items(&self, _: &RequestContext, items: &[&MonitoredItemUpdateRef]) {
        let mut timed = self.timed();
        for item in items {
            timed.remove(&item.handle());
        }
    }

    async fn delete_monitored_items(&self, _: &RequestContext, items: &[&MonitoredItemRef]) {
        let mut timed = self.timed();
        for item in items {
            timed.remove(&item.handle());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_that_runs_backwards_is_not_published() {
        let mut newest = Newest::default();
        let at =
            |ticks: i64| DataValue { source_timestamp: Some(DateTime::from(ticks)), ..DataValue::default() };
        let cases = [(10, true), (20, true), (20, true), (5, false), (19, false), (21, true)];
        for (ticks, may) in cases {
            assert_eq!(newest.may_have_time(&at(ticks)), may, "{ticks}");
            newest.may_have_time(&DataValue::default());
        }
    }
}
