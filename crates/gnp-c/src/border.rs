//! What C sees: types, functions, and the rules for pointers.
//!
//! `include/gnp.h` is made from this file. Comments here are what the reader of the header sees.
#![allow(unsafe_code, reason = "C's pointers; nothing else of the project has any")]
#![deny(unsafe_op_in_unsafe_fn)]

use std::ffi::{CStr, c_char};

use crate::failure::{Failure, guard, reason_text, with_last};
use crate::stream::{Model, Stream};

/// Version of this interface; `gnp_interface()` tells that of the library. A program and a library of the same one fit.
pub const GNP_INTERFACE: u32 = 1;

/// In `GnpTrack.known`: `vx` and `vy` are measured. Otherwise velocities are differences of positions.
pub const GNP_HAS_VELOCITY: u32 = 1;

/// In `GnpTrack.known`: `length` and `width` are measured. Otherwise they are those usual for the kind.
pub const GNP_HAS_SIZE: u32 = 2;

/// What a call came to. All but `GNP_STATUS_OK` set what `gnp_last_error` says.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpStatus {
    /// Done.
    Ok = 0,
    /// A pointer that must not be NULL is.
    NullPointer = 1,
    /// A value that means nothing: a kind that there is not, lane lines out of order, a number out of its range.
    InvalidArgument = 2,
    /// The model is not there, damaged, or of another version.
    Model = 3,
    /// The time of a frame is not after that of the last one. The stream is as it was, and takes the next frame.
    Time = 4,
    /// The model failed for all vehicles of a frame. They are remembered, and the stream takes the next frame.
    Prediction = 5,
    /// A defect of the library. A stream that met one answers so from then on: free it.
    Defect = 6,
}

/// What a vehicle is, in `GnpTrack.kind`.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpKind {
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

/// The recent past of the vehicles of one carriageway. One thread at a time.
#[derive(Debug)]
pub struct GnpStream {
    stream: Stream,
    terms: Vec<GnpTerm>,
}

/// What a model predicts.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpModelInfo {
    /// Steps a second.
    pub rate_hz: f64,
    /// Past that it looks at, s.
    pub observed_s: f64,
    /// Future that it predicts, s.
    pub predicted_s: f64,
}

/// A lane line along the road.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpLine {
    /// Distance to the left of the road's line, or of the x axis, m.
    pub y: f32,
    /// 1: the edge of the carriageway. 0: a line between lanes.
    pub edge: u32,
}

/// A point.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpPoint {
    /// m.
    pub x: f64,
    /// m.
    pub y: f64,
}

/// How a stream works. `gnp_stream_defaults` fills it; change what you want to be otherwise.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpStreamConfig {
    /// Lane lines from right to left, two or more.
    pub lines: *const GnpLine,
    /// Their number.
    pub line_count: usize,
    /// The line of a road that curves, in driving direction; NULL where x is along the road.
    pub road: *const GnpPoint,
    /// Number of its points.
    pub road_count: usize,
    /// Most paths for each vehicle.
    pub modes: usize,
    /// Vehicles that are remembered at once, those missing for a while among them.
    pub max_vehicles: usize,
    /// How long a vehicle that is missing is taken to go on at its velocity, s.
    pub coast_s: f64,
    /// Longest time without a vehicle that is bridged, s; after it the vehicle is a new one.
    pub bridge_s: f64,
    /// Frames a second that are remembered at most.
    pub max_rate_hz: f64,
    /// 1: give the forces behind each path as well. 0: do not.
    pub forces: u32,
}

/// A vehicle of a frame. Where all but id and position is 0, it is a car of usual size whose velocity was not measured.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpTrack {
    /// The same number for a vehicle in all frames.
    pub id: u64,
    /// Centre of its box, m; along the road where the stream has no line of its road.
    pub x: f64,
    /// Centre of its box, m; to the left of x.
    pub y: f64,
    /// Velocity along x, m/s; read with `GNP_HAS_VELOCITY`.
    pub vx: f32,
    /// Velocity along y, m/s; read with `GNP_HAS_VELOCITY`.
    pub vy: f32,
    /// Length, m; read with `GNP_HAS_SIZE`.
    pub length: f32,
    /// Width, m; read with `GNP_HAS_SIZE`.
    pub width: f32,
    /// A `GnpKind`.
    pub kind: u32,
    /// `GNP_HAS_VELOCITY`, `GNP_HAS_SIZE`, both (`|`) or 0.
    pub known: u32,
}

/// What the forecast of a vehicle rests on.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpValidity {
    /// All of the past that the model looks at was seen.
    Full = 0,
    /// The vehicle was seen for `observed_s` only; before, it is taken to have driven at constant velocity.
    Filled = 1,
    /// There is a gap of `gap_s` in the past, longer than one and a half steps of the model, which is interpolated.
    Interpolated = 2,
    /// There is no forecast; `reason` says why.
    None = 3,
}

/// Why a track was not taken as it came, or a vehicle is not predicted; `gnp_reason_text` says it in words.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GnpReason {
    /// There is none.
    None = 0,
    /// A position that is not finite or too far out. The track was left out.
    Position = 1,
    /// A position without a place on the road's line. The track was left out.
    OffRoad = 2,
    /// The same id a second time in the frame. The first track counts.
    Duplicate = 3,
    /// A new vehicle while `max_vehicles` are remembered. The track was left out.
    Capacity = 4,
    /// A velocity that cannot be. The position was used without it.
    Velocity = 5,
    /// A size that cannot be. The one before, or that usual for its kind, was used.
    Size = 6,
    /// One position and no velocity: the next frame will tell.
    NoVelocity = 7,
    /// The model gave numbers that are not finite.
    NotFinite = 8,
    /// Something else.
    Other = 9,
}

/// A vehicle of a result.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpVehicle {
    /// As in `GnpTrack`.
    pub id: u64,
    /// Where it is, m: as in `GnpTrack`, or where it is taken to be while it is missing.
    pub x: f64,
    /// As `x`.
    pub y: f64,
    /// Time since it was seen last, s; 0 if it is in the frame.
    pub age_s: f64,
    /// Time that it was seen for, s, if it is less than the model looks at; otherwise that.
    pub observed_s: f64,
    /// Largest time between two samples of its past, s.
    pub gap_s: f64,
    /// What its forecast rests on.
    pub validity: GnpValidity,
    /// Why there is no forecast.
    pub reason: GnpReason,
    /// Its place among the forecasts; -1 without one.
    pub forecast: i64,
}

/// A track that was not taken as it came.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpProblem {
    /// Id of the track.
    pub id: u64,
    /// Its place in the array of tracks.
    pub row: usize,
    /// What is wrong.
    pub reason: GnpReason,
}

/// A term of the force.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpTerm {
    /// Its name, such as "vehicles".
    pub name: *const c_char,
    /// Acceleration, m/s2, along the road and to the left: `[forecast_count][mode_count][step_count][2]`. The terms add up to
    /// what moves the vehicle.
    pub accelerations: *const f32,
}

/// The forecasts of a frame. The arrays belong to the stream, and stay until it is pushed, reset or freed. All numbers in them
/// are finite.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct GnpResult {
    /// The vehicles: those of the frame in their order but for those left out, then those missing for a while, by id.
    pub vehicles: *const GnpVehicle,
    /// Number of vehicles.
    pub vehicle_count: usize,
    /// Tracks that were not taken as they came.
    pub problems: *const GnpProblem,
    /// Number of these tracks.
    pub problem_count: usize,
    /// Number of vehicles with a forecast.
    pub forecast_count: usize,
    /// Paths of each.
    pub mode_count: usize,
    /// Points of each path; the first is one step of the model after the frame.
    pub step_count: usize,
    /// Probability of each path, 0 to 1: `[forecast_count][mode_count]`. Path 0 is the prediction, the others follow by
    /// falling probability.
    pub probabilities: *const f32,
    /// Centres of the box, x and y, m: `[forecast_count][mode_count][step_count][2]`.
    pub paths: *const f64,
    /// The terms of the force; none unless `GnpStreamConfig.forces` is set.
    pub terms: *const GnpTerm,
    /// Number of terms.
    pub term_count: usize,
}

/// The version of the library, such as "0.1.0".
#[unsafe(no_mangle)]
pub extern "C" fn gnp_version() -> *const c_char {
    const VERSION: &[u8] = concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes();
    VERSION.as_ptr().cast()
}

/// The version of the interface that the library has: compare it with `GNP_INTERFACE`.
#[unsafe(no_mangle)]
pub extern "C" fn gnp_interface() -> u32 {
    GNP_INTERFACE
}

/// What the last failed call of this thread says; "" before the first. Valid until the next call of this thread that fails.
#[unsafe(no_mangle)]
pub extern "C" fn gnp_last_error() -> *const c_char {
    with_last(CStr::as_ptr)
}

/// A reason in words. Stays as long as the library. `reason` is a `GnpReason`.
#[unsafe(no_mangle)]
pub extern "C" fn gnp_reason_text(reason: u32) -> *const c_char {
    reason_text(reason).as_ptr()
}

/// Loads a model: that of a model folder, or with NULL the one that is in the library, trained on NGSIM.
///
/// `*model` is to be freed by `gnp_model_free`; it is NULL on failure.
///
/// # Safety
/// `folder` is NULL or ends with a zero; `model` is NULL or can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_model_load(folder: *const c_char, model: *mut *mut GnpModel) -> GnpStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let folder = unsafe { text(folder, "folder") };
        // SAFETY: the caller's promise.
        unsafe { give(model, "model", || Model::load(folder?).map(GnpModel)) }
    })
}

/// Frees a model; NULL is nothing to do. Streams made from it go on.
///
/// # Safety
/// `model` is NULL or from `gnp_model_load`, and not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_model_free(model: *mut GnpModel) {
    // SAFETY: the caller's promise.
    unsafe { free(model) };
}

/// What the model predicts.
///
/// # Safety
/// `model` is NULL or from `gnp_model_load`; `info` is NULL or can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_model_info(model: *const GnpModel, info: *mut GnpModelInfo) -> GnpStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let model = unsafe { read(model, "model") }?;
        // SAFETY: the caller's promise.
        unsafe { write(info, "info", model.0.info()) }
    })
}

/// Fills `config` with what is usual: 6 paths, 512 vehicles, no forces, a straight road; no lane lines, which are yours to give.
///
/// # Safety
/// `config` is NULL or can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_defaults(config: *mut GnpStreamConfig) -> GnpStatus {
    // SAFETY: the caller's promise.
    guard(|| unsafe { write(config, "config", Stream::defaults()) })
}

/// Starts a stream; what `config` points to is copied. `*stream` is to be freed by `gnp_stream_free`; it is NULL on failure.
///
/// # Safety
/// `model` is NULL or from `gnp_model_load`; `config` is NULL or can be read, as can what it points to; `stream` is NULL or can be
/// written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_new(
    model: *const GnpModel,
    config: *const GnpStreamConfig,
    stream: *mut *mut GnpStream,
) -> GnpStatus {
    guard(|| {
        let make = || {
            // SAFETY: the caller's promise.
            let model = unsafe { read(model, "model") }?;
            // SAFETY: the caller's promise.
            let config = unsafe { read(config, "config") }?;
            // SAFETY: the caller's promise.
            let lines = unsafe { array(config.lines, config.line_count, "config.lines") }?;
            // SAFETY: the caller's promise.
            let road = unsafe { array(config.road, config.road_count, "config.road") }?;
            let stream = Stream::new(&model.0, config, lines, road)?;
            Ok(GnpStream { stream, terms: Vec::new() })
        };
        // SAFETY: the caller's promise.
        unsafe { give(stream, "stream", make) }
    })
}

/// Moves the lane lines from the next frame on.
///
/// # Safety
/// `stream` is NULL or from `gnp_stream_new`, and no other thread uses it; `lines` has `count` lines.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_set_lines(
    stream: *mut GnpStream,
    lines: *const GnpLine,
    count: usize,
) -> GnpStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let stream = unsafe { stream.as_mut() }.ok_or(Failure::Null("stream"))?;
        // SAFETY: the caller's promise.
        let lines = unsafe { array(lines, count, "lines") }?;
        stream.stream.set_lines(lines)
    })
}

/// Forgets all vehicles and the time, as if the stream were new.
///
/// # Safety
/// `stream` is NULL or from `gnp_stream_new`, and no other thread uses it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_reset(stream: *mut GnpStream) -> GnpStatus {
    // SAFETY: the caller's promise.
    guard(|| unsafe { stream.as_mut() }.ok_or(Failure::Null("stream"))?.stream.reset())
}

/// Frees a stream and the arrays of its last result; NULL is nothing to do.
///
/// # Safety
/// `stream` is NULL or from `gnp_stream_new`, and not used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_free(stream: *mut GnpStream) {
    // SAFETY: the caller's promise.
    unsafe { free(stream) };
}

/// Takes in the `count` vehicles that were detected at `time_s`, s, and predicts them.
///
/// Times grow from frame to frame, and may do so unevenly. A track with a value that cannot be does not stop the others: it is
/// left out or used without that value, and is one of `result->problems`. On failure nothing is written to `result`.
///
/// # Safety
/// `stream` is NULL or from `gnp_stream_new`, and no other thread uses it; `tracks` has `count` vehicles; `result` is NULL or can
/// be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn gnp_stream_push(
    stream: *mut GnpStream,
    time_s: f64,
    tracks: *const GnpTrack,
    count: usize,
    result: *mut GnpResult,
) -> GnpStatus {
    guard(|| {
        // SAFETY: the caller's promise.
        let GnpStream { stream, terms } = unsafe { stream.as_mut() }.ok_or(Failure::Null("stream"))?;
        // SAFETY: the caller's promise.
        let tracks = unsafe { array(tracks, count, "tracks") }?;
        if result.is_null() {
            return Err(Failure::Null("result"));
        }
        let flat = stream.push(time_s, tracks)?;
        terms.clear();
        terms.extend(
            flat.term_names
                .iter()
                .zip(flat.frame.terms())
                .map(|(name, term)| GnpTerm { name: name.as_ptr(), accelerations: term.totals.as_ptr().cast() }),
        );
        let all = GnpResult {
            vehicles: flat.vehicles.as_ptr(),
            vehicle_count: flat.vehicles.len(),
            problems: flat.problems.as_ptr(),
            problem_count: flat.problems.len(),
            forecast_count: flat.forecasts,
            mode_count: flat.frame.modes(),
            step_count: flat.frame.steps(),
            probabilities: flat.frame.probabilities().as_ptr(),
            paths: flat.frame.paths().as_ptr().cast(),
            terms: terms.as_ptr(),
            term_count: terms.len(),
        };
        // SAFETY: the caller's promise.
        unsafe { write(result, "result", all) }
    })
}

/// The text at a pointer; `None` where it is null.
///
/// # Safety
/// The pointer is null or what it points to ends with a zero, and stays.
unsafe fn text<'a>(pointer: *const c_char, name: &'static str) -> Result<Option<&'a str>, Failure> {
    if pointer.is_null() {
        return Ok(None);
    }
    // SAFETY: not null, and the caller's promise.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map(Some).map_err(|_| Failure::NotText(name))
}

/// What is at a pointer.
///
/// # Safety
/// The pointer is null or what it points to can be read, and stays unchanged.
unsafe fn read<'a, T>(pointer: *const T, name: &'static str) -> Result<&'a T, Failure> {
    // SAFETY: the caller's promise.
    unsafe { pointer.as_ref() }.ok_or(Failure::Null(name))
}

/// The `count` things from a pointer on.
///
/// # Safety
/// The pointer is null or so many can be read, and stay unchanged.
unsafe fn array<'a, T>(pointer: *const T, count: usize, name: &'static str) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() {
        return Err(Failure::Null(name));
    }
    // A number that was negative before it became one without a sign.
    if count > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Failure::value(name, count as u64, "the number of elements of an array, and no array is so long"));
    }
    // SAFETY: not null, not longer than memory, and the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, count) })
}

/// Writes to a pointer; what was there is not read.
///
/// # Safety
/// The pointer is null or can be written to.
unsafe fn write<T>(pointer: *mut T, name: &'static str, value: T) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::Null(name));
    }
    // SAFETY: not null, and the caller's promise.
    unsafe { pointer.write(value) };
    Ok(())
}

/// Makes something that the caller then owns; null where it cannot be made.
///
/// # Safety
/// The pointer is null or can be written to.
unsafe fn give<T>(
    pointer: *mut *mut T,
    name: &'static str,
    make: impl FnOnce() -> Result<T, Failure>,
) -> Result<(), Failure> {
    // SAFETY: the caller's promise.
    unsafe { write(pointer, name, std::ptr::null_mut()) }?;
    let made = Box::into_raw(Box::new(make()?));
    // SAFETY: the caller's promise.
    unsafe { write(pointer, name, made) }
}

/// Drops what [`give`] gave.
///
/// # Safety
/// The pointer is null or from [`give`], and not used again.
unsafe fn free<T>(pointer: *mut T) {
    if !pointer.is_null() {
        // Nobody is told of a panic here: who frees has no use for what is freed.
        let _ = guard(|| {
            // SAFETY: from `Box::into_raw`, and the caller's promise.
            drop(unsafe { Box::from_raw(pointer) });
            Ok(())
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn last_error() -> String {
        with_last(|text| text.to_string_lossy().into_owned())
    }

    #[test]
    fn a_panic_becomes_a_status() {
        assert_eq!(guard(|| panic!("seven")), GnpStatus::Defect);
        assert!(last_error().contains("seven"), "{}", last_error());
        assert_eq!(guard(|| panic!("{} and\0 more", 8)), GnpStatus::Defect);
        assert!(last_error().contains("8 and"), "{}", last_error());
        assert_eq!(guard(|| Err(Failure::Null("it"))), GnpStatus::NullPointer);
        assert_eq!(guard(|| Ok(())), GnpStatus::Ok);
        assert_eq!(last_error(), "`it` is NULL");
    }

    #[test]
    fn a_panic_while_freeing_stays_inside() {
        struct Bad;
        impl Drop for Bad {
            fn drop(&mut self) {
                panic!("while freed");
            }
        }
        let bad = Box::into_raw(Box::new(Bad));
        // SAFETY: from `Box::into_raw`, and not used again.
        unsafe { free(bad) };
        assert!(last_error().contains("while freed"));
    }
}
