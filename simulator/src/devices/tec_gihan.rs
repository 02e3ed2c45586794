//! Tec Gihan's controller with one plate or two, on a serial line.

use std::collections::VecDeque;
use std::io;

use super::line::Line;
use super::load::{LoadSample, Mounting};
use super::{Connected, HostRequests, Protocol};
use crate::wires::tec_gihan::{BAUD, Dialogue, PlateInfo, State, block};

/// Blocks that the controller buffers for a host that is late with its request.
const KEPT: usize = 10;

/// The controller.
pub struct TecGihan {
    dialogue: Dialogue,
    mounting: Mounting,
    /// The block that is being filled: plate, sample, channel.
    filling: Vec<Vec<[i16; 6]>>,
    ready: VecDeque<Vec<u8>>,
}

impl TecGihan {
    /// A controller with plates of the same kind.
    pub fn new(mut line: Line, plates: usize, mounting: Mounting) -> Connected<TecGihan> {
        line.port().set_baud(BAUD);
        let infos = (0..plates as u32)
            .map(|index| PlateInfo::new(106 + index, -mounting.plate.surface_height_m))
            .collect();
        let dialogue = Dialogue::new(infos);
        let filling = vec![Vec::new(); plates];
        Connected::new(TecGihan { dialogue, mounting, filling, ready: VecDeque::new() }, line)
    }

    fn clear(&mut self) {
        self.ready.clear();
        self.filling.iter_mut().for_each(Vec::clear);
    }

    fn send_what_is_owed(&mut self, line: &mut Line) -> io::Result<()> {
        while self.dialogue.owed > 0 {
            let Some(bytes) = self.ready.pop_front() else { break };
            self.dialogue.owed -= 1;
            line.send(&bytes, self.dialogue.samples_of_a_block() as u32)?;
        }
        Ok(())
    }
}

impl Protocol for TecGihan {
    fn receive(
        &mut self,
        line: &mut Line,
        received: &mut Vec<u8>,
        _device_now_s: f64,
    ) -> io::Result<HostRequests> {
        let (zeroed, state) = (self.dialogue.zeroed, self.dialogue.state);
        line.converse(received, |byte| (self.dialogue.receive(byte), BAUD))?;
        if state != self.dialogue.state {
            self.clear();
        }
        self.send_what_is_owed(line)?;
        Ok(HostRequests { zero: self.dialogue.zeroed != zeroed })
    }

    fn power(&mut self, _line: &mut Line, _on: bool) -> io::Result<()> {
        self.dialogue = Dialogue::new(self.dialogue.plates.clone());
        self.clear();
        Ok(())
    }

    fn rate_hz(&self) -> f64 {
        self.dialogue.rate_hz()
    }

    fn measure(&mut self, line: &mut Line, sample: &LoadSample) -> io::Result<()> {
        if self.dialogue.state != State::Measure {
            return Ok(());
        }
        let range = self.dialogue.range();
        for ((filling, info), wrench) in
            self.filling.iter_mut().zip(&self.dialogue.plates).zip(&sample.plates)
        {
            filling.push(info.counts(range, wrench.components()));
        }
        if self.filling.iter().all(|plate| plate.len() >= self.dialogue.samples_of_a_block()) {
            self.ready.push_back(block(&self.filling));
            self.filling.iter_mut().for_each(Vec::clear);
            if self.ready.len() > KEPT {
                self.ready.pop_front();
            }
        }
        self.send_what_is_owed(line)
    }

    fn config(&self, line: &Line) -> String {
        let ground = self.mounting.config("tec-gihan", line.config());
        format!("{ground}\n[ground.tec_gihan]\nrate_hz = 2500\n")
    }
}
