//! Shared memory: the only importer of iceoryx2, and one table of services.
