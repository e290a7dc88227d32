//! Praxinoscope's host library.
