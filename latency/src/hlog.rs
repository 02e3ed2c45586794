//! Interval logs in the HdrHistogram `.hlog` format, readable by its viewers: one line per stage and interval,
//! the stage's name as tag, times in ns.

use std::io::{self, Write};
use std::time::{Duration, SystemTime};

use hdrhistogram::serialization::interval_log::{IntervalLogWriterBuilder, IntervalLogWriterError, Tag};
use hdrhistogram::serialization::{V2DeflateSerializeError, V2DeflateSerializer};
use thiserror::Error;

use hdrhistogram::Histogram;

use crate::histograms::PathHistograms;
use crate::receipt::{ConsumerTimes, RECEIPT_STAGES};
use crate::stage::Stage;

/// Why an interval log could not be written.
#[derive(Debug, Error)]
pub enum HlogError {
    /// The file could not be written.
    #[error("cannot write the interval log: {0}; is the disk full?")]
    Io(#[from] io::Error),
    /// A histogram could not be encoded.
    #[error("cannot encode the histogram of stage {stage} for the interval log: {reason}")]
    Encode {
        /// The stage's name.
        stage: String,
        /// hdrhistogram's reason.
        reason: V2DeflateSerializeError,
    },
}

/// Writes an interval log. Allocates: for the latency log or a consumer, never for the loop or egress.
pub struct HlogWriter<W: Write> {
    writer: W,
    serializer: V2DeflateSerializer,
}

impl<W: Write> HlogWriter<W> {
    /// Starts a log; `start` is the wall-clock time that the intervals count from.
    ///
    /// # Errors
    /// [`HlogError::Io`] if the head cannot be written.
    pub fn new(mut writer: W, start: SystemTime) -> Result<Self, HlogError> {
        let mut serializer = V2DeflateSerializer::new();
        let mut builder = IntervalLogWriterBuilder::new();
        builder.add_comment("[Histogram log format version 1.3]");
        for stage in Stage::ALL {
            builder.add_comment(&format!("Tag {}, ns: {}", stage.name(), stage.definition()));
        }
        for (name, definition) in RECEIPT_STAGES {
            builder.add_comment(&format!("Tag CONSUMER.{name}, ns: {definition}"));
        }
        builder.with_start_time(start).with_base_time(start);
        builder.begin_log_with(&mut writer, &mut serializer)?;
        // The column heads as HdrHistogram's own Java writer puts them; other readers expect the line.
        writeln!(
            writer,
            "\"StartTimestamp\",\"Interval_Length\",\"Interval_Max\",\"Interval_Compressed_Histogram\""
        )?;
        Ok(HlogWriter { writer, serializer })
    }

    /// Writes one interval and flushes it: one line per stage that recorded anything.
    ///
    /// `since_start` is when the interval began, `length` how long it lasted.
    ///
    /// # Errors
    /// [`HlogError`] if a histogram cannot be encoded or the file cannot be written.
    pub fn write_interval(
        &mut self,
        since_start: Duration,
        length: Duration,
        histograms: &PathHistograms,
    ) -> Result<(), HlogError> {
        for stage in Stage::ALL {
            self.write_one(since_start, length, stage.name(), &histograms.stage(stage).times_ns)?;
        }
        self.writer.flush()?;
        Ok(())
    }

    /// Writes what consumers saw in an interval and flushes it: `CONSUMER.receipt` and the others as tags.
    ///
    /// # Errors
    /// As [`HlogWriter::write_interval`].
    pub fn write_consumers(
        &mut self,
        since_start: Duration,
        length: Duration,
        consumers: &[ConsumerTimes],
    ) -> Result<(), HlogError> {
        for consumer in consumers {
            for ((name, _), times_ns) in RECEIPT_STAGES.iter().zip(&consumer.times_ns) {
                self.write_one(since_start, length, &format!("{}.{name}", consumer.name), times_ns)?;
            }
        }
        self.writer.flush()?;
        Ok(())
    }

    fn write_one(
        &mut self,
        since_start: Duration,
        length: Duration,
        tag: &str,
        times_ns: &Histogram<u64>,
    ) -> Result<(), HlogError> {
        if times_ns.is_empty() {
            return Ok(());
        }
        // A builder without comments and times writes no head, so it serves for every line.
        let mut log =
            IntervalLogWriterBuilder::new().begin_log_with(&mut self.writer, &mut self.serializer)?;
        log.write_histogram(times_ns, since_start, length, Tag::new(tag)).map_err(|error| match error {
            IntervalLogWriterError::IoError(error) => HlogError::Io(error),
            IntervalLogWriterError::SerializeError(reason) => {
                HlogError::Encode { stage: tag.to_owned(), reason }
            }
        })
    }

    /// The writer beneath.
    pub fn writer_mut(&mut self) -> &mut W {
        &mut self.writer
    }

    /// The writer beneath.
    pub fn into_inner(self) -> W {
        self.writer
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::Zeroable;
    use equipoise_core::message::CycleRecord;
    use hdrhistogram::serialization::interval_log::{IntervalLogIterator, LogEntry};

    #[test]
    fn hdrhistogram_reads_back_what_was_written() {
        let mut histograms = PathHistograms::new();
        let start = SystemTime::UNIX_EPOCH + Duration::from_secs(1_700_000_000);
        let mut log = HlogWriter::new(Vec::new(), start).unwrap();
        for interval in 0..3_u64 {
            histograms.start_interval();
            for n in 1..=100 {
                let cycle = interval * 100 + n;
                let due_ns = cycle * 1_000_000;
                let woken_ns = due_ns + n * 1_000;
                histograms.record(&CycleRecord { cycle, due_ns, woken_ns, ..Zeroable::zeroed() });
            }
            let since_start = Duration::from_secs(10 * interval);
            log.write_interval(since_start, Duration::from_secs(10), &histograms).unwrap();
        }
        let bytes = log.into_inner();
        let entries: Vec<_> = IntervalLogIterator::new(&bytes).map(Result::unwrap).collect();
        assert_eq!(entries[0], LogEntry::StartTime(Duration::from_secs(1_700_000_000)));
        assert_eq!(entries[1], LogEntry::BaseTime(Duration::from_secs(1_700_000_000)));
        assert_eq!(entries.len(), 2 + 3, "only loop.wake has both stamps");
        for (index, entry) in entries[2..].iter().enumerate() {
            let LogEntry::Interval(interval) = entry else { panic!("{entry:?}") };
            assert_eq!(interval.tag().map(|tag| tag.as_str()), Some("loop.wake"));
            assert_eq!(interval.start_timestamp(), Duration::from_secs(10 * index as u64));
            assert!((interval.max() - 100_000.0).abs() < 200.0, "{}", interval.max());
        }
    }
}
