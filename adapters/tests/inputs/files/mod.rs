//! What is read from files: captures, recordings, real data.

mod capture_bioware;
mod capture_csv;
mod capture_mvnx;
mod capture_pcap;
mod fusion;
mod kistler_volts;
mod mvnx_file;
mod real_datagrams;
mod recording;
