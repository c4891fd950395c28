//! What C sees: types, functions, and the rules for pointers.
//!
//! `include/gnp.h` is made from this file. Comments here are what the reader of the header sees.
#![allow(unsafe_code, reason = "C's pointers; nothing else of the project has any")]
#![deny(unsafe_op_in_unsafe_fn)]

use std::ffi::{CStr, c_char};

use crate::failure::{Failure, guard, with_last};
use crate::flat::{Model, Stream};

/// Version of this interface; `gnp_interface()` tells that of the library. A program and a library of the same one fit.
pub const GNP_INTERFACE: u32 = 1;

/// In `GnpTrack.known`: `vx` and `vy` are measured. Otherwise velocities are differences of positions.
pub const GNP_HAS_VELOCITY: u32 = 1;

/// In `GnpTrack.known`: `length` and `width` are measured. Otherwise they are those usual for the class.
pub const GNP_HAS_SIZE: u32 = 2;

/// What a call came to. All but `GNP_STATUS_OK` set what `gnp_last_error` says, and leave their results untouched.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpStatus {
    /// Done.
    Ok = 0,
    /// A pointer that must not be NULL is.
    NullPointer = 1,
    /// A value that means nothing: an unknown class, a text that is not UTF-8, lines out of order.
    InvalidArgument = 2,
    /// The model is not there, damaged, or not one of this version.
    Model = 3,
    /// The frame is refused whole: its time is not after that of the last one, or there are more vehicles than
    /// `capacity`. The stream is as before, and takes the next frame.
    Frame = 4,
    /// The forecast failed.
    Prediction = 5,
    /// A defect of the library. A stream that met one answers so from then on: free it.
    Defect = 6,
}

/// What a vehicle is, for `GnpTrack.class_of`.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpClass {
    /// A car or van, or not known.
    Car = 0,
    /// A truck or bus.
    Truck = 1,
    /// A motorcycle.
    Motorcycle = 2,
}

/// A trained model. Loaded once, shared by any number of streams and threads.
#[derive(Debug)]
pub struct GnpModel(Model);

/// A stream of frames with the recent past of each vehicle. One thread at a time.
#[derive(Debug)]
pub struct GnpStream(Stream);

/// What a model predicts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpModelInfo {
    /// Rate of its steps, Hz.
    pub rate_hz: f64,
    /// Past that it looks at, s.
    pub observed_s: f64,
    /// Future that it predicts, s.
    pub predicted_s: f64,
    /// Steps of a path; the first is `1 / rate_hz` after the frame.
    pub steps: usize,
}

/// A lane line along the road.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpLine {
    /// Offset to the left of the road's axis, m.
    pub y: f32,
    /// 1: the edge of the carriageway; 0: a line between lanes.
    pub edge: u32,
}

/// How a stream works. Fill it by `gnp_stream_defaults`, then change what you want to.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpStreamConfig {
    /// Lane lines from right to left.
    pub lines: *const GnpLine,
    /// Their number.
    pub line_count: usize,
    /// Paths a vehicle, 1 or more.
    pub modes: usize,
    /// Vehicles at a time; more are refused.
    pub capacity: usize,
    /// 1: give the forces behind each path as well. 0: do not.
    pub forces: u32,
}

/// A vehicle in a frame. What is set to zero is: a car at the origin without measured velocity and size.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpTrack {
    /// The same for a vehicle in all frames.
    pub id: u64,
    /// Centre of its box, m: forward along the road.
    pub x: f64,
    /// To the left, m.
    pub y: f64,
    /// Velocity along x, m/s; read with `GNP_HAS_VELOCITY`.
    pub vx: f32,
    /// Velocity along y, m/s.
    pub vy: f32,
    /// Length, m; read with `GNP_HAS_SIZE`.
    pub length: f32,
    /// Width, m.
    pub width: f32,
    /// A `GnpClass`.
    pub class_of: u32,
    /// `GNP_HAS_VELOCITY`, `GNP_HAS_SIZE`, both (`|`) or 0.
    pub known: u32,
}

/// How much of the past a forecast rests on.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpValidity {
    /// All that the model looks at was seen.
    Full = 0,
    /// The vehicle was seen for `observed_s` only; before, it is taken to have driven as it did first.
    Filled = 1,
    /// The longest gap between two samples, `gap_s`, is longer than a step of the model; positions there are interpolated.
    Interpolated = 2,
    /// There is no forecast: `gnp_vehicle_reason` says why, probabilities and paths are 0.
    None = 3,
}

/// A vehicle of a result.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpVehicle {
    /// As in `GnpTrack`.
    pub id: u64,
    /// How much of the past the forecast rests on.
    pub validity: GnpValidity,
    /// Seen past, s.
    pub observed_s: f32,
    /// Longest gap in it, s.
    pub gap_s: f32,
}
