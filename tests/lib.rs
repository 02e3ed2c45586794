//! Nothing but the tests beside it; each file says what it holds Equipoise to.
