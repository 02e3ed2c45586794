//! A network that loses, reorders, repeats and damages datagrams: a wrapper around a socket.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use crate::random::Random;

/// How bad the network is: probabilities for each datagram.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Faults {
    /// It never arrives.
    pub loss: f64,
    /// It arrives after the one behind it.
    pub reorder: f64,
    /// It arrives twice.
    pub duplicate: f64,
    /// One of its bytes is another. A network's checksums refuse such a datagram nearly always.
    pub corrupt: f64,
    /// Its end is missing.
    pub truncate: f64,
    /// One of as many bytes, all of them 0xff, arrives before it.
    pub garbage: f64,
}

/// Sends datagrams through the faults.
#[derive(Debug)]
pub struct FaultySender {
    faults: Faults,
    random: Random,
    held: Option<Vec<u8>>,
}

impl FaultySender {
    /// A sender with the misfortunes of a seed.
    pub fn new(faults: Faults, seed: u64) -> FaultySender {
        FaultySender { faults, random: Random::new(seed, "faults"), held: None }
    }

    /// The network is another from the next datagram on.
    pub fn set_faults(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// Sends one datagram, or what the faults make of it.
    ///
    /// # Errors
    /// Those of the socket, but not that nobody listens: a real sensor does not care.
    pub fn send(&mut self, socket: &UdpSocket, datagram: &[u8], to: SocketAddr) -> io::Result<()> {
        for datagram in self.afflict(datagram) {
            match socket.send_to(&datagram, to) {
                Err(error) if error.kind() != io::ErrorKind::ConnectionRefused => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }

    /// What arrives when this datagram is sent.
    fn afflict(&mut self, datagram: &[u8]) -> Vec<Vec<u8>> {
        let mut arriving = Vec::new();
        // Every draw is taken, so that one fault's probability does not shift another's luck.
        let Faults { loss, reorder, duplicate, corrupt, truncate, garbage } = self.faults;
        let [lost, late, twice, damaged, cut, garbage] =
            [loss, reorder, duplicate, corrupt, truncate, garbage]
                .map(|probability| self.random.happens(probability));
        let before = self.held.take();
        if garbage {
            arriving.push(vec![0xff; datagram.len()]);
        }
        if !lost {
            let mut copy = datagram.to_vec();
            if damaged && !copy.is_empty() {
                let place = self.random.between(0.0, copy.len() as f64) as usize;
                copy[place] ^= 1 << (self.random.between(0.0, 8.0) as u32);
            }
            if cut {
                copy.truncate(self.random.between(0.0, copy.len() as f64) as usize);
            }
            if late && before.is_none() {
                self.held = Some(copy);
            } else {
                if twice {
                    arriving.push(copy.clone());
                }
                arriving.push(copy);
            }
        }
        arriving.extend(before);
        arriving
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arriving(faults: Faults) -> Vec<u8> {
        let mut sender = FaultySender::new(faults, 1);
        (0..100).flat_map(|number| sender.afflict(&[number])).map(|datagram| datagram[0]).collect()
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
            let mut sender = FaultySender::new(Faults::default(), 1);
            sender.set_faults(faults);
            (0..100).flat_map(|number| sender.afflict(&[number; 20])).collect::<Vec<_>>()
        };
        let cut = arriving(Faults { truncate: 0.2, ..Faults::default() });
        assert!(cut.len() == 100 && cut.iter().filter(|datagram| datagram.len() < 20).count() > 5);
        let garbage = arriving(Faults { garbage: 0.2, ..Faults::default() });
        assert_eq!(garbage.iter().filter(|datagram| **datagram == [0xff; 20]).count(), garbage.len() - 100);
        assert!(garbage.len() > 105);
    }
}
