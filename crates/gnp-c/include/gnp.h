/* GNP: forecasts of vehicles on motorways, frame by frame. SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * A model is loaded once; from it, streams are made, one for each carriageway. Each frame of tracks is pushed into its stream,
 * which answers with the forecasts of all vehicles in flat arrays. Lengths are in m, times in s. Functions that can fail return
 * a GnpStatus.
 *
 * Threads: a model may be used by any number of threads at a time; a stream, and the arrays of its last result, by one thread
 * at a time, which need not always be the same one. gnp_last_error is of the thread that calls it. A call computes on the
 * thread that makes it.
 *
 * Generated from crates/gnp-c/src/border.rs by `cargo xtask c --write`; change that file. */

#ifndef GNP_H
#define GNP_H

#include <stddef.h>
#include <stdint.h>

/**
 * Version of this interface; `gnp_interface()` tells that of the library. A program and a library of the same one fit.
 */
#define GNP_INTERFACE 1

/**
 * In `GnpTrack.known`: `vx` and `vy` are measured. Otherwise velocities are differences of positions.
 */
#define GNP_HAS_VELOCITY 1

/**
 * In `GnpTrack.known`: `length` and `width` are measured. Otherwise they are those usual for the kind.
 */
#define GNP_HAS_SIZE 2

/**
 * Why a track was not taken as it came, or a vehicle is not predicted; `gnp_reason_text` says it in words.
 */
enum GnpReason
#ifdef __cplusplus
  : uint32_t
#endif // __cplusplus
 {
    /**
     * There is none.
     */
    GNP_REASON_NONE = 0,
    /**
     * A position that is not finite or too far out. The track was left out.
     */
    GNP_REASON_POSITION = 1,
    /**
     * A position without a place on the road's line. The track was left out.
     */
    GNP_REASON_OFF_ROAD = 2,
    /**
     * The same id a second time in the frame. The first track counts.
     */
    GNP_REASON_DUPLICATE = 3,
    /**
     * A new vehicle while `max_vehicles` are remembered. The track was left out.
     */
    GNP_REASON_CAPACITY = 4,
    /**
     * A velocity that cannot be. The position was used without it.
     */
    GNP_REASON_VELOCITY = 5,
    /**
     * A size that cannot be. The one before, or that usual for its kind, was used.
     */
    GNP_REASON_SIZE = 6,
    /**
     * One position and no velocity: the next frame will tell.
     */
    GNP_REASON_NO_VELOCITY = 7,
    /**
     * The model gave numbers that are not finite.
     */
    GNP_REASON_NOT_FINITE = 8,
    /**
     * Something else.
     */
    GNP_REASON_OTHER = 9,
};
#ifndef __cplusplus
typedef uint32_t GnpReason;
#endif // __cplusplus

/**
 * What a call came to. All but `GNP_STATUS_OK` set what `gnp_last_error` says.
 */
enum GnpStatus
#ifdef __cplusplus
  : int32_t
#endif // __cplusplus
 {
    /**
     * Done.
     */
    GNP_STATUS_OK = 0,
    /**
     * A pointer that must not be NULL is.
     */
    GNP_STATUS_NULL_POINTER = 1,
    /**
     * A value that means nothing: a kind that there is not, lane lines out of order, a number out of its range.
     */
    GNP_STATUS_INVALID_ARGUMENT = 2,
    /**
     * The model is not there, damaged, or of another version.
     */
    GNP_STATUS_MODEL = 3,
    /**
     * The time of a frame is not after that of the last one. The stream is as it was, and takes the next frame.
     */
    GNP_STATUS_TIME = 4,
    /**
     * The model failed for all vehicles of a frame. They are remembered, and the stream takes the next frame.
     */
    GNP_STATUS_PREDICTION = 5,
    /**
     * A defect of the library. A stream that met one answers so from then on: free it.
     */
    GNP_STATUS_DEFECT = 6,
};
#ifndef __cplusplus
typedef int32_t GnpStatus;
#endif // __cplusplus

/**
 * What the forecast of a vehicle rests on.
 */
enum GnpValidity
#ifdef __cplusplus
  : uint32_t
#endif // __cplusplus
 {
    /**
     * All of the past that the model looks at was seen.
     */
    GNP_VALIDITY_FULL = 0,
    /**
     * The vehicle was seen for `observed_s` only; before, it is taken to have driven at constant velocity.
     */
    GNP_VALIDITY_FILLED = 1,
    /**
     * There is a gap of `gap_s` in the past, longer than one and a half steps of the model, which is interpolated.
     */
    GNP_VALIDITY_INTERPOLATED = 2,
    /**
     * There is no forecast; `reason` says why.
     */
    GNP_VALIDITY_NONE = 3,
};
#ifndef __cplusplus
typedef uint32_t GnpValidity;
#endif // __cplusplus

/**
 * A trained model. Loaded once, shared by any number of streams and threads.
 */
typedef struct GnpModel GnpModel;

/**
 * The recent past of the vehicles of one carriageway. One thread at a time.
 */
typedef struct GnpStream GnpStream;

/**
 * What a model predicts.
 */
typedef struct GnpModelInfo {
    /**
     * Steps a second.
     */
    double rate_hz;
    /**
     * Past that it looks at, s.
     */
    double observed_s;
    /**
     * Future that it predicts, s.
     */
    double predicted_s;
} GnpModelInfo;

/**
 * A lane line along the road.
 */
typedef struct GnpLine {
    /**
     * Distance to the left of the road's line, or of the x axis, m.
     */
    float y;
    /**
     * 1: the edge of the carriageway. 0: a line between lanes.
     */
    uint32_t edge;
} GnpLine;

/**
 * A point.
 */
typedef struct GnpPoint {
    /**
     * m.
     */
    double x;
    /**
     * m.
     */
    double y;
} GnpPoint;

/**
 * How a stream works. `gnp_stream_defaults` fills it; change what you want to be otherwise.
 */
typedef struct GnpStreamConfig {
    /**
     * Lane lines from right to left, two or more.
     */
    const struct GnpLine *lines;
    /**
     * Their number.
     */
    size_t line_count;
    /**
     * The line of a road that curves, in driving direction; NULL where x is along the road.
     */
    const struct GnpPoint *road;
    /**
     * Number of its points.
     */
    size_t road_count;
    /**
     * Most paths for each vehicle.
     */
    size_t modes;
    /**
     * Vehicles that are remembered at once, those missing for a while among them.
     */
    size_t max_vehicles;
    /**
     * How long a vehicle that is missing is taken to go on at its velocity, s.
     */
    double coast_s;
    /**
     * Longest time without a vehicle that is bridged, s; after it the vehicle is a new one.
     */
    double bridge_s;
    /**
     * Frames a second that are remembered at most.
     */
    double max_rate_hz;
    /**
     * 1: give the forces behind each path as well. 0: do not.
     */
    uint32_t forces;
} GnpStreamConfig;

/**
 * A vehicle of a frame. Where all but id and position is 0, it is a car of usual size whose velocity was not measured.
 */
typedef struct GnpTrack {
    /**
     * The same number for a vehicle in all frames.
     */
    uint64_t id;
    /**
     * Centre of its box, m; along the road where the stream has no line of its road.
     */
    double x;
    /**
     * Centre of its box, m; to the left of x.
     */
    double y;
    /**
     * Velocity along x, m/s; read with `GNP_HAS_VELOCITY`.
     */
    float vx;
    /**
     * Velocity along y, m/s; read with `GNP_HAS_VELOCITY`.
     */
    float vy;
    /**
     * Length, m; read with `GNP_HAS_SIZE`.
     */
    float length;
    /**
     * Width, m; read with `GNP_HAS_SIZE`.
     */
    float width;
    /**
     * A `GnpKind`.
     */
    uint32_t kind;
    /**
     * `GNP_HAS_VELOCITY`, `GNP_HAS_SIZE`, both (`|`) or 0.
     */
    uint32_t known;
} GnpTrack;

/**
 * A vehicle of a result.
 */
typedef struct GnpVehicle {
    /**
     * As in `GnpTrack`.
     */
    uint64_t id;
    /**
     * Where it is, m: as in `GnpTrack`, or where it is taken to be while it is missing.
     */
    double x;
    /**
     * As `x`.
     */
    double y;
    /**
     * Time since it was seen last, s; 0 if it is in the frame.
     */
    double age_s;
    /**
     * Time that it was seen for, s, if it is less than the model looks at; otherwise that.
     */
    double observed_s;
    /**
     * Largest time between two samples of its past, s.
     */
    double gap_s;
    /**
     * What its forecast rests on.
     */
    GnpValidity validity;
    /**
     * Why there is no forecast.
     */
    GnpReason reason;
    /**
     * Its place among the forecasts; -1 without one.
     */
    int64_t forecast;
} GnpVehicle;

/**
 * A track that was not taken as it came.
 */
typedef struct GnpProblem {
    /**
     * Id of the track.
     */
    uint64_t id;
    /**
     * Its place in the array of tracks.
     */
    size_t row;
    /**
     * What is wrong.
     */
    GnpReason reason;
} GnpProblem;

/**
 * A term of the force.
 */
typedef struct GnpTerm {
    /**
     * Its name, such as "vehicles".
     */
    const char *name;
    /**
     * Acceleration, m/s2, along the road and to the left: `[forecast_count][mode_count][step_count][2]`. The terms add up to
     * what moves the vehicle.
     */
    const float *accelerations;
} GnpTerm;

/**
 * The forecasts of a frame. The arrays belong to the stream, and stay until it is pushed, reset or freed. All numbers in them
 * are finite.
 */
typedef struct GnpResult {
    /**
     * The vehicles: those of the frame in their order but for those left out, then those missing for a while, by id.
     */
    const struct GnpVehicle *vehicles;
    /**
     * Number of vehicles.
     */
    size_t vehicle_count;
    /**
     * Tracks that were not taken as they came.
     */
    const struct GnpProblem *problems;
    /**
     * Number of these tracks.
     */
    size_t problem_count;
    /**
     * Number of vehicles with a forecast.
     */
    size_t forecast_count;
    /**
     * Paths of each.
     */
    size_t mode_count;
    /**
     * Points of each path; the first is one step of the model after the frame.
     */
    size_t step_count;
    /**
     * Probability of each path, 0 to 1: `[forecast_count][mode_count]`. Path 0 is the prediction, the others follow by
     * falling probability.
     */
    const float *probabilities;
    /**
     * Centres of the box, x and y, m: `[forecast_count][mode_count][step_count][2]`.
     */
    const double *paths;
    /**
     * The terms of the force; none unless `GnpStreamConfig.forces` is set.
     */
    const struct GnpTerm *terms;
    /**
     * Number of terms.
     */
    size_t term_count;
} GnpResult;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * The version of the library, such as "0.1.0".
 */
const char *gnp_version(void);

/**
 * The version of the interface that the library has: compare it with `GNP_INTERFACE`.
 */
uint32_t gnp_interface(void);

/**
 * What the last failed call of this thread says; "" before the first. Valid until the next call of this thread that fails.
 */
const char *gnp_last_error(void);

/**
 * A reason in words. Stays as long as the library. `reason` is a `GnpReason`.
 */
const char *gnp_reason_text(uint32_t reason);

/**
 * Loads a model: that of a model folder, or with NULL the one that is in the library, trained on NGSIM.
 *
 * `*model` is to be freed by `gnp_model_free`; it is NULL on failure.
 *
 * The caller sees to it that:
 * `folder` is NULL or ends with a zero; `model` is NULL or can be written to.
 */
GnpStatus gnp_model_load(const char *folder, struct GnpModel **model);

/**
 * Frees a model; NULL is nothing to do. Streams made from it go on.
 *
 * The caller sees to it that:
 * `model` is NULL or from `gnp_model_load`, and not used again.
 */
void gnp_model_free(struct GnpModel *model);

/**
 * What the model predicts.
 *
 * The caller sees to it that:
 * `model` is NULL or from `gnp_model_load`; `info` is NULL or can be written to.
 */
GnpStatus gnp_model_info(const struct GnpModel *model, struct GnpModelInfo *info);

/**
 * Fills `config` with what is usual: 6 paths, 512 vehicles, no forces, a straight road; no lane lines, which are yours to give.
 *
 * The caller sees to it that:
 * `config` is NULL or can be written to.
 */
GnpStatus gnp_stream_defaults(struct GnpStreamConfig *config);

/**
 * Starts a stream; what `config` points to is copied. `*stream` is to be freed by `gnp_stream_free`; it is NULL on failure.
 *
 * The caller sees to it that:
 * `model` is NULL or from `gnp_model_load`; `config` is NULL or can be read, as can what it points to; `stream` is NULL or can be
 * written to.
 */
GnpStatus gnp_stream_new(const struct GnpModel *model,
                         const struct GnpStreamConfig *config,
                         struct GnpStream **stream);

/**
 * Moves the lane lines from the next frame on.
 *
 * The caller sees to it that:
 * `stream` is NULL or from `gnp_stream_new`, and no other thread uses it; `lines` has `count` lines.
 */
GnpStatus gnp_stream_set_lines(struct GnpStream *stream, const struct GnpLine *lines, size_t count);

/**
 * Forgets all vehicles and the time, as if the stream were new.
 *
 * The caller sees to it that:
 * `stream` is NULL or from `gnp_stream_new`, and no other thread uses it.
 */
GnpStatus gnp_stream_reset(struct GnpStream *stream);

/**
 * Frees a stream and the arrays of its last result; NULL is nothing to do.
 *
 * The caller sees to it that:
 * `stream` is NULL or from `gnp_stream_new`, and not used again.
 */
void gnp_stream_free(struct GnpStream *stream);

/**
 * Takes in the `count` vehicles that were detected at `time_s`, s, and predicts them.
 *
 * Times grow from frame to frame, and may do so unevenly. A track with a value that cannot be does not stop the others: it is
 * left out or used without that value, and is one of `result->problems`. On failure nothing is written to `result`.
 *
 * The caller sees to it that:
 * `stream` is NULL or from `gnp_stream_new`, and no other thread uses it; `tracks` has `count` vehicles; `result` is NULL or can
 * be written to.
 */
GnpStatus gnp_stream_push(struct GnpStream *stream,
                          double time_s,
                          const struct GnpTrack *tracks,
                          size_t count,
                          struct GnpResult *result);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GNP_H */
