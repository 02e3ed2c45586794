//! Where time goes along the path: stages, histograms, reports.
