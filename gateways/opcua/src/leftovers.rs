//! Resources that disconnected clients leave behind in the OPC UA library, and that only a new server releases.
//!
//! A session that ends without closing (its link breaks) leaves its subscriptions, which live as long as its client
//! requested: the publishing interval has no upper limit. The library keeps an expired subscription with its
//! unacknowledged notifications, because its last message is never fetched. It also keeps the items of expired and
//! deleted subscriptions; each costs time at every tick. The library offers no way to remove them. So they are counted,
//! and the server ends before they become a burden; the service manager restarts the process.

use std::collections::BTreeSet;
use std::time::Instant;

use opcua::server::{ServerHandle, Subscription, SubscriptionCache};
use opcua::types::{VariableId, Variant};

/// Leftover items allowed: each holds up to 20 values, about 40 MB in total.
pub const ITEMS_MAX: usize = 10_000;
/// Leftover subscriptions allowed, including those without items of this namespace.
pub const SUBSCRIPTIONS_MAX: usize = 1_000;

/// Numbers of subscriptions and of monitored items.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Held {
    /// Subscriptions.
    pub subscriptions: usize,
    /// Monitored items of the subscriptions.
    pub items: usize,
}

impl Held {
    /// The reason why the server must end if it holds too many resources beyond those of `living` sessions.
    pub fn too_much(self, living: Held) -> Option<String> {
        let items = self.items.saturating_sub(living.items);
        let subscriptions = self.subscriptions.saturating_sub(living.subscriptions);
        (items > ITEMS_MAX || subscriptions > SUBSCRIPTIONS_MAX).then(|| {
            format!(
                "clients that came and went have left {subscriptions} subscriptions and {items} monitored items behind; \
                 only a restarted server releases them. If this recurs, look for a client whose connection breaks, or \
                 that creates its subscriptions again and again"
            )
        })
    }
}

/// Resources of live sessions. Removes sessions that no longer have any from `sessions`.
pub fn living(subscriptions: &SubscriptionCache, sessions: &mut BTreeSet<u32>) -> Held {
    let mut living = Held::default();
    let now = Instant::now();
    sessions.retain(|session| {
        let Some(of_session) = subscriptions.get_session_subscriptions(*session) else { return false };
        let of_session = of_session.lock();
        if of_session.session().read().deadline() >= now {
            let ids = of_session.subscription_ids();
            living.subscriptions += ids.len();
            living.items +=
                ids.iter().filter_map(|id| of_session.get(*id)).map(Subscription::len).sum::<usize>();
        }
        true
    });
    living
}

/// Subscriptions held by the library, by its own counter, which includes expired ones.
pub fn subscriptions_held(handle: &ServerHandle) -> usize {
    let count = VariableId::Server_ServerDiagnostics_ServerDiagnosticsSummary_CurrentSubscriptionCount;
    match handle.info().diagnostics.get(count).and_then(|count| count.value) {
        Some(Variant::UInt32(count)) => count as usize,
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_lives_is_not_left_behind() {
        let held = |subscriptions, items| Held { subscriptions, items };
        assert_eq!(held(500, 50_000).too_much(held(500, 50_000)), None);
        assert_eq!(held(501, 60_000).too_much(held(500, 50_000)), None);
        assert!(held(501, 60_001).too_much(held(500, 50_000)).is_some());
        assert!(held(1_001, 0).too_much(held(0, 0)).is_some());
        // Items of other namespaces also belong to live sessions, but are not counted in `held`.
        assert_eq!(held(0, 0).too_much(held(5, 5_000)), None);
    }
}
