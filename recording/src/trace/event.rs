//! Events of one cycle, and their encoding (Trace Event Format: phases X, b, e, i, C and M; times in µs).

use core::fmt;

use equipoise_core::message::{CommandKind, CycleRecord};
use equipoise_latency::Stage;

/// The viewer displays all tracks as one process.
const PROCESS: u32 = 1;

/// Row of a thread; the number determines the order.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Track {
    Adapters = 1,
    Ingress = 2,
    Loop = 3,
    Egress = 4,
}

impl Track {
    /// Events that name the process and the rows.
    pub(super) fn names() -> impl Iterator<Item = String> {
        let process = format!(
            r#"{{"ph":"M","pid":{PROCESS},"tid":0,"name":"process_name","args":{{"name":"equipoise"}}}}"#
        );
        let rows = [
            (Track::Adapters, "adapters"),
            (Track::Ingress, "ingress"),
            (Track::Loop, "loop"),
            (Track::Egress, "egress"),
        ];
        let row = |(track, name): (Track, &str)| {
            let tid = track as u32;
            [
                format!(
                    r#"{{"ph":"M","pid":{PROCESS},"tid":{tid},"name":"thread_name","args":{{"name":"{name}"}}}}"#
                ),
                format!(
                    r#"{{"ph":"M","pid":{PROCESS},"tid":{tid},"name":"thread_sort_index","args":{{"sort_index":{tid}}}}}"#
                ),
            ]
        };
        std::iter::once(process).chain(rows.into_iter().flat_map(row))
    }

    /// The track of the thread that completes a stage.
    fn of(stage: Stage) -> Track {
        match stage {
            Stage::SuitTransport | Stage::SuitAdapter | Stage::GroundTransport | Stage::GroundAdapter => {
                Track::Adapters
            }
            Stage::SuitIngress | Stage::GroundIngress => Track::Ingress,
            Stage::EgressWake | Stage::EgressPublish => Track::Egress,
            _ => Track::Loop,
        }
    }
}

/// Whether a thread works in this stage; the other stages are waiting times.
fn is_work(stage: Stage) -> bool {
    matches!(stage, Stage::LoopIntake | Stage::LoopCompute | Stage::EgressPublish)
}

/// Argument of an event.
#[derive(Debug, Clone, Copy)]
pub(super) enum Value {
    Whole(u64),
    /// ns, written as µs.
    Micros(u64),
    Text(&'static str),
}

#[derive(Debug, Clone, Copy)]
enum Phase {
    /// Slice of a thread; length in ns.
    Slice(u64),
    /// Begin and end of a wait, matched by the number.
    Begins(u64),
    Ends(u64),
    Instant,
    Counter,
}

/// One event.
#[derive(Debug, Clone)]
pub(super) struct Event {
    phase: Phase,
    track: Track,
    name: &'static str,
    at_ns: u64,
    args: Vec<(&'static str, Value)>,
}

/// All events of a cycle in order of time; `before` is the previous record, if any.
pub(super) fn events_of(record: &CycleRecord, before: Option<&CycleRecord>) -> Vec<Event> {
    let mut events = Vec::with_capacity(32);
    let cycle = ("cycle", Value::Whole(record.cycle));
    if record.woken_ns > 0 && record.compute_end_ns >= record.woken_ns {
        let length = Phase::Slice(record.compute_end_ns - record.woken_ns);
        let args = vec![
            cycle,
            ("suit_taken", Value::Whole(record.suit_taken.into())),
            ("ground_taken", Value::Whole(record.ground_taken.into())),
        ];
        events.push(Event { phase: length, track: Track::Loop, name: "cycle", at_ns: record.woken_ns, args });
    }
    for stage in Stage::ALL.into_iter().filter(|stage| stage.is_elementary()) {
        let Some(Ok((from_ns, to_ns))) = stage.span_ns(record) else { continue };
        let (track, name, args) = (Track::of(stage), stage.name(), vec![cycle]);
        if is_work(stage) {
            events.push(Event { phase: Phase::Slice(to_ns - from_ns), track, name, at_ns: from_ns, args });
        } else {
            let begins = Phase::Begins(record.cycle);
            events.push(Event { phase: begins, track, name, at_ns: from_ns, args });
            let ends = Phase::Ends(record.cycle);
            events.push(Event { phase: ends, track, name, at_ns: to_ns, args: Vec::new() });
        }
    }
    push_instants(record, before, &mut events);
    count(record, &mut events);
    // The sort is stable: of two events that begin at once, the enclosing one was added first.
    events.sort_by_key(|event| event.at_ns);
    events
}

fn push_instants(record: &CycleRecord, before: Option<&CycleRecord>, events: &mut Vec<Event>) {
    let cycle = ("cycle", Value::Whole(record.cycle));
    let mut push_instant = |name, at_ns, what: Option<(&'static str, Value)>| {
        let args = std::iter::once(cycle).chain(what).collect();
        events.push(Event { phase: Phase::Instant, track: Track::Loop, name, at_ns, args });
    };
    if record.deadline_missed != 0 {
        push_instant("deadline missed", record.due_ns + record.period_ns, None);
    }
    if record.command != 0 {
        let kind = CommandKind::from_number(record.command);
        let name = kind.map_or(Value::Whole(record.command.into()), |kind| Value::Text(command_name(kind)));
        push_instant("command", record.compute_start_ns, Some(("command", name)));
    }
    // A decreasing number means that the daemon was restarted.
    let Some(before) = before.filter(|before| before.cycle < record.cycle) else { return };
    let skipped = record.slots_skipped.saturating_sub(before.slots_skipped);
    if skipped > 0 {
        push_instant("slots skipped", record.due_ns, Some(("slots", Value::Whole(skipped))));
    }
    let missing = record.cycle - before.cycle - 1;
    if missing > 0 {
        push_instant("not recorded", record.due_ns, Some(("cycles", Value::Whole(missing))));
    }
}

fn count(record: &CycleRecord, events: &mut Vec<Event>) {
    let mut count = |name, at_ns, args| {
        events.push(Event { phase: Phase::Counter, track: Track::Loop, name, at_ns, args });
    };
    if let Some(Ok((_, woken_ns))) = Stage::LoopWake.span_ns(record) {
        let lateness = Value::Micros(woken_ns - record.due_ns);
        count("lateness", woken_ns, vec![("us", lateness)]);
    }
    if record.compute_start_ns > 0 {
        let values = vec![
            ("suit", Value::Whole(record.suit_taken.into())),
            ("ground", Value::Whole(record.ground_taken.into())),
        ];
        count("samples taken", record.compute_start_ns, values);
    }
}

fn command_name(kind: CommandKind) -> &'static str {
    match kind {
        CommandKind::IdentifyStart => "identify start",
        CommandKind::IdentifyStop => "identify stop",
        CommandKind::IdentifyReset => "identify reset",
        CommandKind::UndoLift => "subject undo-lift",
        CommandKind::Checkpoint => "checkpoint",
        CommandKind::SubjectSave => "subject save",
        CommandKind::SubjectLoad => "subject load",
        CommandKind::Tare => "tare",
        CommandKind::PoseSkip => "identify skip",
        CommandKind::SubjectDelete => "subject delete",
        CommandKind::Reload => "reload",
    }
}

/// µs with all digits of the ns: a double would round the times of a machine with an uptime of months.
struct Micros(u64);

impl fmt::Display for Micros {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:03}", self.0 / 1000, self.0 % 1000)
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Whole(number) => write!(f, "{number}"),
            Value::Micros(ns) => write!(f, "{}", Micros(*ns)),
            // All texts are constants that need no escaping.
            Value::Text(text) => write!(f, "\"{text}\""),
        }
    }
}

/// The event as a JSON object.
impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Event { phase, track, name, at_ns, args } = self;
        let letter = match phase {
            Phase::Slice(_) => "X",
            Phase::Begins(_) => "b",
            Phase::Ends(_) => "e",
            Phase::Instant => "i",
            Phase::Counter => "C",
        };
        write!(f, r#"{{"ph":"{letter}","pid":{PROCESS},"tid":{},"name":"{name}","#, *track as u32)?;
        write!(f, r#""ts":{}"#, Micros(*at_ns))?;
        match phase {
            Phase::Slice(length_ns) => write!(f, r#","dur":{}"#, Micros(*length_ns))?,
            // Stage and cycle together identify a wait.
            Phase::Begins(id) | Phase::Ends(id) => write!(f, r#","cat":"{name}","id":"{id:#x}""#)?,
            Phase::Instant => f.write_str(r#","s":"t""#)?,
            Phase::Counter => {}
        }
        for (index, (name, value)) in args.iter().enumerate() {
            let before = if index == 0 { r#","args":{"# } else { "," };
            write!(f, r#"{before}"{name}":{value}"#)?;
        }
        f.write_str(if args.is_empty() { "}" } else { "}}" })
    }
}
