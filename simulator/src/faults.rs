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
    /// One of its bytes is another.
    pub corrupt: f64,
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
        let [lost, late, twice, damaged] =
            [self.faults.loss, self.faults.reorder, self.faults.duplicate, self.faults.corrupt]
                .map(|probability| self.random.happens(probability));
        let before = self.held.take();
        if !lost {
            let mut copy = datagram.to_vec();
            if damaged && !copy.is_empty() {
                let place = self.random.between(0.0, copy.len() as f64) as usize;
                copy[place] ^= 1 << (self.random.between(0.0, 8.0) as u32);
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
}
