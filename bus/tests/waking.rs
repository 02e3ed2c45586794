//! Events wake, commands are answered.
#![expect(clippy::unwrap_used, reason = "a test may panic, and so may its helpers")]

mod common;

use bytemuck::Zeroable;
use common::{PATIENCE, join, root, until};
use equipoise_bus::{BusError, Channel, Event};
use equipoise_core::message::{Command, CommandKind, Reply};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

fn command(kind: CommandKind) -> Command {
    Command { kind: kind as u32, ..Command::zeroed() }
}

fn echo(command: &Command) -> Reply {
    Reply { cycle: u64::from(command.kind), ..Reply::zeroed() }
}

#[test]
fn an_event_wakes_its_own_channel_only() {
    let root = root();
    let bus = join(root.path(), "both");
    let (inputs, results) = (bus.listener(Channel::Inputs).unwrap(), bus.listener(Channel::Results).unwrap());
    let notifier = bus.notifier(Channel::Inputs).unwrap();
    for _ in 0..1000 {
        assert_eq!(notifier.notify(Event::NewSuit).unwrap(), 1);
    }
    notifier.notify(Event::NewGround).unwrap();
    let events = inputs.wait(PATIENCE).unwrap();
    assert_eq!(events.iter().collect::<Vec<_>>(), [Event::NewSuit, Event::NewGround]);
    assert!(inputs.wait(Duration::ZERO).unwrap().is_empty());
    assert!(results.wait(Duration::from_millis(1)).unwrap().is_empty());
}

#[test]
fn a_sleeper_is_woken_from_another_thread() {
    let root = root();
    let bus = join(root.path(), "sleeper");
    let listener = bus.listener(Channel::Results).unwrap();
    thread::scope(|scope| {
        scope.spawn(|| {
            let notifier = join(root.path(), "waker").notifier(Channel::Results).unwrap();
            thread::sleep(Duration::from_millis(50));
            notifier.notify(Event::PhaseChanged).unwrap();
        });
        assert!(listener.wait(PATIENCE).unwrap().contains(Event::PhaseChanged));
    });
}

#[test]
fn a_command_wakes_the_daemon_and_is_answered() {
    let root = root();
    let (ready, done) = (AtomicBool::new(false), AtomicBool::new(false));
    thread::scope(|scope| {
        scope.spawn(|| {
            let bus = join(root.path(), "daemon");
            let mut server = bus.command_server().unwrap();
            let wake = bus.listener(Channel::Inputs).unwrap();
            ready.store(true, Ordering::SeqCst);
            while !done.load(Ordering::SeqCst) {
                if wake.wait(Duration::from_millis(50)).unwrap().contains(Event::CommandArrived) {
                    while server.poll(echo).unwrap() {}
                }
            }
        });
        until("the daemon serves", || ready.load(Ordering::SeqCst));
        let client = join(root.path(), "client").command_client().unwrap();
        for kind in CommandKind::ALL {
            let reply = client.ask(&command(kind), PATIENCE).unwrap();
            assert_eq!((reply.refused, reply.cycle), (0, kind as u64));
        }
        done.store(true, Ordering::SeqCst);
    });
}

#[test]
fn without_a_daemon_the_client_gets_an_error() {
    let root = root();
    let client = join(root.path(), "client").command_client().unwrap();
    let error = client.ask(&command(CommandKind::Tare), PATIENCE).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no answer on equipoise/test/command: no daemon runs on this station; start `equipoise run`"
    );
}

#[test]
fn a_command_given_up_is_never_carried_out() {
    let root = root();
    let bus = join(root.path(), "both");
    let mut server = bus.command_server().unwrap();
    let client = bus.command_client().unwrap();
    for _ in 0..20 {
        let error = client.ask(&command(CommandKind::Tare), Duration::from_millis(5)).unwrap_err();
        assert!(matches!(error, BusError::NoAnswer { .. }), "{error}");
    }
    while server.poll(|_| panic!("no request was sent")).unwrap() {}
}
