//! Engine common to all ground devices: opens the connection, exchanges data with the device's state machine, and
//! reconnects after a failure.

use super::error::SourceError;
use super::transport::Transport;
use crate::clock::now_monotonic_ns;
use crate::counts::{Counts, HealthReporter, Stream};
use crate::ground::{Action, GroundDevice, GroundProtocol, GroundRefusal, GroundSettings};
use equipoise_core::message::{AdapterHealth, GroundSample, Printable};
use std::time::Duration;

/// Retry interval of a connection that could not be opened or failed.
const REOPEN_NS: u64 = 500_000_000;
/// Timeout of a call while there is no connection to wait on.
const IDLE: Duration = Duration::from_millis(50);
/// Maximum count of consecutive actions of a device before its bytes are read again.
const WANTS_MAX: usize = 8;

/// Maximum length of a sentence about a device, which may quote the device; own texts have at most some 400 characters.
const SENTENCE_CHARS_MAX: usize = 1000;

/// Sanitises a sentence for display, as it may contain the device's own names and error texts.
fn printable(sentence: String) -> String {
    Printable { text: &sentence, chars_max: SENTENCE_CHARS_MAX }.to_string()
}

/// A ground device that streams.
pub struct GroundSource {
    transport: Box<dyn Transport>,
    protocol: GroundProtocol,
    health: HealthReporter,
    open: bool,
    opened_at_ns: u64,
    diagnostic: Option<String>,
}

impl core::fmt::Debug for GroundSource {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let GroundSource { protocol, open, diagnostic, .. } = self;
        f.debug_struct("GroundSource")
            .field("protocol", protocol)
            .field("open", open)
            .field("diagnostic", diagnostic)
            .finish_non_exhaustive()
    }
}

impl GroundSource {
    /// Opens the connection to a device. An absent device is no error: connecting is retried, and [`Self::diagnostic`]
    /// reports it.
    ///
    /// # Errors
    /// Failures of this machine: an address that it does not have, a port that is in use.
    pub fn open(
        transport: Box<dyn Transport>,
        device: Box<dyn GroundDevice>,
        settings: GroundSettings,
    ) -> Result<GroundSource, SourceError> {
        let mut source = GroundSource {
            transport,
            protocol: GroundProtocol::new(device, settings),
            health: HealthReporter::new(Stream::Ground, now_monotonic_ns()),
            open: false,
            opened_at_ns: 0,
            diagnostic: None,
        };
        source.reopen(now_monotonic_ns())?;
        if source.open {
            source.serve(now_monotonic_ns())?;
        }
        Ok(source)
    }

    /// Waits for data and appends the samples to `samples`; returns their count, zero after a short timeout.
    ///
    /// # Errors
    /// Permanent failures: the socket was shut down, or this machine lost the address.
    pub fn receive(&mut self, samples: &mut Vec<GroundSample>) -> Result<usize, SourceError> {
        let now_ns = now_monotonic_ns();
        if !self.open && now_ns.saturating_sub(self.opened_at_ns) >= REOPEN_NS {
            self.reopen(now_ns)?;
        }
        if self.open {
            self.serve(now_ns)?;
        }
        if !self.open {
            std::thread::sleep(IDLE);
            return Ok(0);
        }
        let before = samples.len();
        match self.transport.receive() {
            Ok(None) => {}
            Ok(Some(incoming)) if !incoming.admitted => self.protocol.refuse(GroundRefusal::ForeignSender),
            Ok(Some(incoming)) => {
                self.protocol.receive(incoming.bytes, incoming.arrival_ns, samples);
                if samples.len() > before {
                    self.transport.accepted();
                }
            }
            Err(error) => self.failed(error)?,
        }
        Ok(samples.len() - before)
    }

    /// The current fault and its remedy, in a sentence; `None` without a fault.
    pub fn diagnostic(&self) -> Option<String> {
        let diagnostic = if self.open { self.protocol.diagnostic() } else { self.diagnostic.clone() };
        diagnostic.map(printable)
    }

    /// A property that the device reports, in a sentence; `None` if there is none.
    pub fn note(&self) -> Option<String> {
        self.protocol.note().map(printable)
    }

    /// Counts since the start.
    pub fn counts(&self) -> &Counts {
        self.protocol.counts()
    }

    /// Duration of the blocks in which the device collects readings, ns; 0 if it sends each by itself.
    pub fn block_latency_ns(&self) -> u64 {
        self.protocol.block_latency_ns()
    }

    /// The counts as a message, with the rate since the last call. Reasons in the order of [`GroundRefusal`].
    pub fn health(&mut self) -> AdapterHealth {
        let health = self.health.report(self.protocol.counts(), now_monotonic_ns());
        AdapterHealth { block_latency_ns: self.protocol.block_latency_ns(), ..health }
    }

    fn reopen(&mut self, now_ns: u64) -> Result<(), SourceError> {
        self.opened_at_ns = now_ns;
        match self.transport.open() {
            Ok(()) => {
                (self.open, self.diagnostic) = (true, None);
                match (self.transport.goes_on(), self.transport.begins_at_start()) {
                    (true, _) => {}
                    (false, true) => self.protocol.opened_at_start(now_ns),
                    (false, false) => self.protocol.opened(now_ns),
                }
                Ok(())
            }
            Err(error) => self.failed(error),
        }
    }

    /// Executes the actions that the device requests.
    fn serve(&mut self, now_ns: u64) -> Result<(), SourceError> {
        for _ in 0..WANTS_MAX {
            let done = match self.protocol.next_action(now_ns) {
                Action::Nothing => break,
                Action::Send(bytes) => self.transport.send(&bytes),
                Action::Speed(baud) => self.transport.set_speed(baud),
                Action::Reopen(reason) => {
                    (self.open, self.diagnostic) = (false, Some(reason));
                    break;
                }
            };
            if let Err(error) = done {
                self.failed(error)?;
                break;
            }
        }
        Ok(())
    }

    /// Retries after the loss of a device; passes other errors to the caller.
    fn failed(&mut self, error: SourceError) -> Result<(), SourceError> {
        if !error.may_recover() {
            return Err(error);
        }
        (self.open, self.diagnostic) = (false, Some(error.to_string()));
        Ok(())
    }
}

impl Drop for GroundSource {
    fn drop(&mut self) {
        if let (true, Some(close_command)) = (self.open, self.protocol.close_command()) {
            // If the device is unreachable, it detects the closed connection by itself.
            let _unreachable = self.transport.send(&close_command);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::file_line::{Begin, FileLine};
    use super::super::transport::Incoming;
    use super::*;
    use crate::ground::channels::{Channels, Direct, ForceUnit, MomentUnit};
    use crate::ground::device::text::{Column, Framing, Text, TextSettings};
    use crate::wire::text_line::{Decimal, Delimiter, LineForm};
    use std::io::Write;
    use std::time::Instant;

    /// A file on a network share that fails on request.
    struct Share {
        line: FileLine,
        fails: crossbeam_channel::Receiver<()>,
    }

    impl Transport for Share {
        fn open(&mut self) -> Result<(), SourceError> {
            self.line.open()
        }

        fn goes_on(&self) -> bool {
            self.line.goes_on()
        }

        fn receive(&mut self) -> Result<Option<Incoming<'_>>, SourceError> {
            if self.fails.try_recv().is_ok() {
                let (what, remedy) = ("the share".to_owned(), "\u{1b}]0;x\n".repeat(1000));
                return Err(SourceError::Absent {
                    what,
                    remedy,
                    error: std::io::Error::from_raw_os_error(5),
                });
            }
            self.line.receive()
        }

        fn send(&mut self, bytes: &[u8]) -> Result<(), SourceError> {
            self.line.send(bytes)
        }
    }

    fn force_lines(framing: Framing) -> Box<dyn GroundDevice> {
        let direct = Direct { force: [None, None, Some(0)], ..Direct::default() };
        Box::new(Text::new(TextSettings {
            form: LineForm {
                delimiter: Delimiter::Comma,
                decimal: Decimal::Point,
                comment: None,
                prefix: Vec::new(),
                fields: 1,
            },
            framing,
            header_lines: 1,
            longest: 100,
            columns: vec![Column { field: 0, scale: 1.0, offset: 0.0 }],
            channels: Channels::direct(1, direct, ForceUnit::Newton, MomentUnit::NewtonMetre).unwrap(),
            time: None,
            sequence: None,
        }))
    }

    fn forces_n(source: &mut GroundSource, want: usize) -> Vec<f64> {
        let (mut samples, until) = (Vec::new(), Instant::now() + Duration::from_secs(10));
        while samples.len() < want && Instant::now() < until {
            source.receive(&mut samples).unwrap();
        }
        samples.iter().map(|sample| sample.force_n[2]).collect()
    }

    #[test]
    fn a_new_file_is_read_from_its_first_line_and_a_partial_line_is_skipped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("export.txt");
        std::fs::write(&path, "Fz\n-600\n-6").unwrap();
        let line = Box::new(FileLine::new(path.clone(), Begin::End, "ground.file.path"));
        let settings = GroundSettings::default();
        let mut source = GroundSource::open(line, force_lines(Framing::Joined), settings).unwrap();
        let mut file = std::fs::File::options().append(true).open(&path).unwrap();
        file.write_all(b"01\nFz\n-602\n").unwrap();
        assert_eq!(forces_n(&mut source, 1), [602.0], "a partial first line is skipped");
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, "Fz\n-701\n-702\n").unwrap();
        assert_eq!(forces_n(&mut source, 2), [701.0, 702.0]);
    }

    #[test]
    fn a_file_that_could_not_be_read_for_a_while_goes_on_in_the_middle_of_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("export.txt");
        let mut file = std::fs::File::create(&path).unwrap();
        let (fail, fails) = crossbeam_channel::bounded(1);
        let line = FileLine::new(path, Begin::Start, "ground.file.path");
        let share = Box::new(Share { line, fails });
        let mut source =
            GroundSource::open(share, force_lines(Framing::Stream), GroundSettings::default()).unwrap();
        file.write_all(b"Fz\n-701\n-7").unwrap();
        assert_eq!(forces_n(&mut source, 1), [701.0]);
        fail.send(()).unwrap();
        source.receive(&mut Vec::new()).unwrap();
        let said = source.diagnostic().expect("it is not there");
        assert!(said.contains("the share is not there") && !said.contains(['\u{1b}', '\n']), "{said}");
        assert!(said.len() < 10 * SENTENCE_CHARS_MAX, "{}", said.len());
        file.write_all(b"02\n-703\n").unwrap();
        assert_eq!(forces_n(&mut source, 2), [702.0, 703.0]);
    }
}
