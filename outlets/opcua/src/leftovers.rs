//! What clients leave behind in the library, for which there is no other cure than a new server.
//!
//! A session that ends without a word (its link breaks) leaves its subscriptions, which live for as long as its client
//! liked: there is no largest publishing interval. When one has expired, the library keeps it with what nobody
//! acknowledged, for its last message has no taker. And it never forgets the items of a subscription that expired or was
//! deleted: each costs time in every beat. None of this can be cleared away from outside. So it is counted, and before it
//! becomes a burden the server ends; whoever watches the process starts it anew.

use std::collections::BTreeSet;
use std::time::Instant;

use opcua::server::{ServerHandle, Subscription, SubscriptionCache};
use opcua::types::{VariableId, Variant};

/// Items that may be left: 20 values of each wait at worst, some 40 MB.
pub const ITEMS_MAX: usize = 10_000;
/// Subscriptions that may be left, also those without items of ours.
pub const SUBSCRIPTIONS_MAX: usize = 1_000;

/// Subscriptions, and monitored items.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Held {
    /// Subscriptions.
    pub subscriptions: usize,
    /// Items of them.
    pub items: usize,
}

impl Held {
    /// Why the server has to end, if what it holds beyond what lives is too much.
    pub fn too_much(self, living: Held) -> Option<String> {
        let items = self.items.saturating_sub(living.items);
        let subscriptions = self.subscriptions.saturating_sub(living.subscriptions);
        (items > ITEMS_MAX || subscriptions > SUBSCRIPTIONS_MAX).then(|| {
            format!(
                "clients that came and went have left {subscriptions} subscriptions and {items} monitored items behind; \
                 only a new server is rid of them. If this comes often, look for a client whose connection breaks, or \
                 that makes its subscriptions ever anew"
            )
        })
    }
}

/// What belongs to sessions that live. Sessions that are gone with all they had are taken out of `sessions`.
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

/// Subscriptions that the library holds: its own count, which those that expired never leave.
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
        // Items of other nodes live, too, and are not among those that are held.
        assert_eq!(held(0, 0).too_much(held(5, 5_000)), None);
    }
}
