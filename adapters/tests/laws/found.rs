//! Inputs that once violated a property: name of the property, bytes, and the fault.

/// All of them; the faults are fixed.
pub(crate) const FOUND: &[(&str, &[u8], &str)] = &[
    (
        "pcap",
        b"\x0a\x0d\x0d\x0a\x1c\0\0\0\x4d\x3c\x2b\x1a\x01\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff\x1c\0\0\0\
          \x01\0\0\x80\x08\0\0\0\0\0\0\0\0\0\0\0",
        "a block that announces 8 bytes, less than any has: an overflow in the parser of blocks",
    ),
    (
        "pcap",
        b"\x0a\x0d\x0d\x0a\x1c\0\0\0\x4d\x3c\x2b\x1a\x01\0\0\0\xff\xff\xff\xff\xff\xff\xff\xff\x1c\0\0\0\
          \x06\0\0\0\x20\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\xfe\xff\xff\xff\0\0\0\0\x20\0\0\0",
        "a packet of nearly 4 GiB: an overflow where its length is aligned",
    ),
    (
        "mvn_datagram",
        b"MXTP12\0\0\0\0\x80\x01\0\0\0\0\0\x17\0\0\0\0\0\x1c\0\0\0\x18color:1\nname:F\n7\nname:F\r",
        "a name that ends in a carriage return was reported with it, and without it after writing",
    ),
];
