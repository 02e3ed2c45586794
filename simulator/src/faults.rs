//! A network that loses, reorders, repeats and damages datagrams, or the pieces of a stream.

use crate::random::Random;

/// Fault probabilities for each datagram, or each packet of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// It never arrives.
    pub loss: f64,
    /// It arrives after the one behind it.
    pub reorder: f64,
    /// It arrives twice.
    pub duplicate: f64,
    /// One of its bytes is changed. A network's checksums reject such a datagram nearly always.
    pub corrupt: f64,
    /// Its end is missing.
    pub truncate: f64,
    /// A packet of the same length, all bytes 0xff, arrives before it; in a stream up to 40 bytes of noise.
    pub garbage: f64,
    /// A stream's bytes arrive in pieces of any length, whatever their packets; always at 1.
    pub chop: f64,
}

/// Counters of a faulty connection, in samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultCounts {
    /// Sent.
    pub sent: u64,
    /// Never arrived.
    pub lost: u64,
    /// Arrived damaged or cut.
    pub damaged: u64,
    /// Arrived twice.
    pub doubled: u64,
    /// Arrived after those behind them.
    pub late: u64,
    /// How often garbage was inserted.
    pub garbage: u64,
}

impl core::ops::Add for FaultCounts {
    type Output = FaultCounts;

    fn add(self, other: FaultCounts) -> FaultCounts {
        FaultCounts {
            sent: self.sent + other.sent,
            lost: self.lost + other.lost,
            damaged: self.damaged + other.damaged,
            doubled: self.doubled + other.doubled,
            late: self.late + other.late,
            garbage: self.garbage + other.garbage,
        }
    }
}

/// Faults of one packet.
#[derive(Debug, Clone, Copy)]
struct PacketFaults {
    lost: bool,
    late: bool,
    twice: bool,
    damaged: bool,
    cut: bool,
    garbage: bool,
    chopped: bool,
}

impl PacketFaults {
    fn draw(faults: Faults, random: &mut Random) -> PacketFaults {
        let Faults { loss, reorder, duplicate, corrupt, truncate, garbage, chop } = faults;
        // Every draw is made, so that one fault's probability does not change the random sequence of another.
        let [lost, late, twice, damaged, cut, garbage] =
            [loss, reorder, duplicate, corrupt, truncate, garbage].map(|chance| random.happens(chance));
        PacketFaults { lost, late, twice, damaged, cut, garbage, chopped: chop > 0.0 && random.happens(chop) }
    }

    /// The packet as it arrives.
    fn apply(self, packet: &[u8], random: &mut Random) -> Vec<u8> {
        let mut copy = packet.to_vec();
        if self.damaged && !copy.is_empty() {
            let place = random.between(0.0, copy.len() as f64) as usize;
            copy[place] ^= 1 << (random.between(0.0, 8.0) as u32);
        }
        if self.cut {
            copy.truncate(random.between(0.0, copy.len() as f64) as usize);
        }
        copy
    }
}

/// Applies the faults to packets, and counts them.
#[derive(Debug)]
pub struct FaultyStream {
    faults: Faults,
    random: Random,
    /// A datagram delayed until after the next one.
    held: Option<Vec<u8>>,
    /// The end of a stream's packet, delivered with the next one.
    rest: Vec<u8>,
    counts: FaultCounts,
}

impl FaultyStream {
    /// With the faults of a seed.
    pub fn new(faults: Faults, seed: u64) -> FaultyStream {
        let random = Random::new(seed, "faults");
        FaultyStream { faults, random, held: None, rest: Vec::new(), counts: FaultCounts::default() }
    }

    /// Replaces the faults from the next packet on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// Counters of the sent samples.
    pub fn fault_counts(&self) -> FaultCounts {
        self.counts
    }

    fn draw_faults(&mut self, samples: u32) -> PacketFaults {
        let drawn = PacketFaults::draw(self.faults, &mut self.random);
        let (samples, reported) = (u64::from(samples), &mut self.counts);
        reported.sent += samples;
        reported.garbage += u64::from(drawn.garbage);
        if drawn.lost {
            reported.lost += samples;
        } else if drawn.damaged || drawn.cut {
            reported.damaged += samples;
        } else if drawn.twice {
            reported.doubled += samples;
        }
        drawn
    }

    /// Datagrams that arrive when this one is sent.
    pub fn datagrams(&mut self, datagram: &[u8], samples: u32) -> Vec<Vec<u8>> {
        let mut arriving = Vec::new();
        let drawn = self.draw_faults(samples);
        let before = self.held.take();
        if drawn.garbage {
            arriving.push(vec![0xff; datagram.len()]);
        }
        if !drawn.lost {
            let copy = drawn.apply(datagram, &mut self.random);
            if drawn.late && before.is_none() {
                self.counts.late += u64::from(samples);
                self.held = Some(copy);
            } else {
                if drawn.twice {
                    arriving.push(copy.clone());
                }
                arriving.push(copy);
            }
        }
        arriving.extend(before);
        arriving
    }

    /// Bytes that arrive on a stream when this packet is sent: a stream keeps the order.
    pub fn bytes(&mut self, packet: &[u8], samples: u32) -> Vec<u8> {
        let drawn = self.draw_faults(samples);
        let mut arriving = std::mem::take(&mut self.rest);
        if drawn.garbage {
            let length = self.random.between(1.0, 41.0) as usize;
            arriving.extend((0..length).map(|_| self.random.between(0.0, 256.0) as u8));
        }
        if !drawn.lost {
            let copy = drawn.apply(packet, &mut self.random);
            arriving.extend_from_slice(&copy);
            if drawn.twice {
                arriving.extend_from_slice(&copy);
            }
        }
        if drawn.chopped {
            self.rest = arriving.split_off(self.random.between(0.0, arriving.len() as f64 + 1.0) as usize);
        }
        arriving
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arriving(faults: Faults) -> Vec<u8> {
        let mut sender = FaultyStream::new(faults, 1);
        (0..100).flat_map(|number| sender.datagrams(&[number], 1)).map(|datagram| datagram[0]).collect()
    }

    #[test]
    fn without_faults_all_arrive_in_order() {
        assert_eq!(arriving(Faults::default()), (0..100).collect::<Vec<u8>>());
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let lossy = arriving(Faults { loss: 0.2, ..Faults::default() });
        assert!((60..95).contains(&lossy.len()) && lossy.is_sorted());
        let doubled = arriving(Faults { duplicate: 0.2, ..Faults::default() });
        assert!(doubled.len() > 105 && doubled.is_sorted());
        let disordered = arriving(Faults { reorder: 0.2, ..Faults::default() });
        assert!(!disordered.is_sorted());
        let mut sorted = disordered.clone();
        sorted.sort_unstable();
        assert!(sorted.windows(2).all(|pair| pair[0] != pair[1]) && sorted.len() >= 99);
        let damaged = arriving(Faults { corrupt: 0.2, ..Faults::default() });
        assert!(damaged.iter().zip(0..).filter(|(is, was)| *is != was).count() > 5);
    }

    #[test]
    fn what_is_cut_or_garbage_is_not_the_datagram_that_was_sent() {
        let arriving = |faults| {
            let mut sender = FaultyStream::new(Faults::default(), 1);
            sender.set_faults(faults);
            (0..100).flat_map(|number| sender.datagrams(&[number; 20], 1)).collect::<Vec<_>>()
        };
        let cut = arriving(Faults { truncate: 0.2, ..Faults::default() });
        assert!(cut.len() == 100 && cut.iter().filter(|datagram| datagram.len() < 20).count() > 5);
        let garbage = arriving(Faults { garbage: 0.2, ..Faults::default() });
        assert_eq!(garbage.iter().filter(|datagram| **datagram == [0xff; 20]).count(), garbage.len() - 100);
        assert!(garbage.len() > 105);
    }

    #[test]
    fn a_chopped_stream_loses_nothing_and_keeps_no_boundaries() {
        let mut stream = FaultyStream::new(Faults { chop: 1.0, ..Faults::default() }, 1);
        let pieces: Vec<_> = (0..100).map(|number| stream.bytes(&[number; 20], 1)).collect();
        let joined = pieces.concat();
        assert!(joined.is_sorted() && joined.len() > 100 * 20 - 120);
        assert!(pieces.iter().filter(|piece| piece.len() != 20).count() > 50);
        assert_eq!(stream.fault_counts(), FaultCounts { sent: 100, ..FaultCounts::default() });
    }

    #[test]
    fn a_stream_is_cut_damaged_and_full_of_noise_as_it_counts() {
        let faults = Faults { loss: 0.1, corrupt: 0.1, truncate: 0.1, garbage: 0.1, ..Faults::default() };
        let mut stream = FaultyStream::new(faults, 3);
        let arriving: Vec<_> = (0..400).map(|number| stream.bytes(&[number as u8; 20], 2)).collect();
        let reported = stream.fault_counts();
        let empty = arriving.iter().filter(|bytes| bytes.is_empty()).count() as u64;
        assert!(reported.sent == 800 && reported.lost / 2 >= empty && empty > 20, "{reported:?}");
        let sound =
            arriving.iter().zip(0..).filter(|(bytes, number)| **bytes == [*number as u8; 20]).count() as u64;
        assert!(
            sound * 2 >= 800 - reported.lost - reported.damaged - 2 * reported.garbage,
            "{reported:?} {sound}"
        );
    }
}
