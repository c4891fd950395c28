//! The web server of GNP: a scene one can change, with live forecasts, and the same as an HTTP API.
