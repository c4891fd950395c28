/* What the library makes of wrong use and of tracks that cannot be, and that threads do not disturb each other. Run under
 * AddressSanitizer, which ends the program where memory is misused or left. */
#include <gnp.h>

#include <math.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define REQUIRE(condition)                                                                                   \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            fprintf(stderr, "%s:%d: not so: %s (last error: %s)\n", __FILE__, __LINE__, #condition,          \
                    gnp_last_error());                                                                       \
            exit(EXIT_FAILURE);                                                                              \
        }                                                                                                    \
    } while (0)

/* Requires that a call fails so, and says `word`. */
#define REFUSED(call, status, word) REQUIRE((call) == (status) && strstr(gnp_last_error(), (word)) != NULL)

static const GnpLine LINES[] = {{-3.7f, 1}, {0.0f, 0}, {3.7f, 1}};

static GnpStreamConfig usual(void) {
    GnpStreamConfig config;
    REQUIRE(gnp_stream_defaults(&config) == GNP_STATUS_OK);
    config.lines = LINES;
    config.line_count = 3;
    return config;
}

static GnpTrack car(uint64_t id, double x, double y, float speed) {
    GnpTrack track = {.id = id, .x = x, .y = y, .vx = speed, .known = GNP_HAS_VELOCITY};
    return track;
}

static void require_finite(const GnpResult *result) {
    const size_t paths = result->forecast_count * result->mode_count;
    const size_t numbers = paths * result->step_count * 2;
    for (size_t i = 0; i < paths; i++) {
        REQUIRE(result->probabilities[i] >= 0.0f && result->probabilities[i] <= 1.0f);
    }
    for (size_t i = 0; i < numbers; i++) {
        REQUIRE(isfinite(result->paths[i]));
    }
    for (size_t term = 0; term < result->term_count; term++) {
        REQUIRE(strlen(result->terms[term].name) > 0);
        for (size_t i = 0; i < numbers; i++) {
            REQUIRE(isfinite(result->terms[term].accelerations[i]));
        }
    }
    for (size_t i = 0; i < result->vehicle_count; i++) {
        const GnpVehicle *vehicle = &result->vehicles[i];
        REQUIRE(vehicle->forecast < (int64_t)result->forecast_count);
        REQUIRE((vehicle->forecast < 0) == (vehicle->validity == GNP_VALIDITY_NONE));
        REQUIRE((vehicle->reason == GNP_REASON_NONE) == (vehicle->validity != GNP_VALIDITY_NONE));
    }
}

static void null_pointers(const GnpModel *model) {
    GnpModel *none = NULL;
    GnpModelInfo info;
    GnpStream *stream = NULL;
    GnpStreamConfig config = usual();
    GnpResult result;
    const GnpTrack track = car(1, 0.0, 1.0, 20.0f);
    REFUSED(gnp_model_load(NULL, NULL), GNP_STATUS_NULL_POINTER, "model");
    REFUSED(gnp_model_info(NULL, &info), GNP_STATUS_NULL_POINTER, "model");
    REFUSED(gnp_model_info(model, NULL), GNP_STATUS_NULL_POINTER, "info");
    REFUSED(gnp_stream_defaults(NULL), GNP_STATUS_NULL_POINTER, "config");
    REFUSED(gnp_stream_new(NULL, &config, &stream), GNP_STATUS_NULL_POINTER, "model");
    REFUSED(gnp_stream_new(model, NULL, &stream), GNP_STATUS_NULL_POINTER, "config");
    REFUSED(gnp_stream_new(model, &config, NULL), GNP_STATUS_NULL_POINTER, "stream");
    config.lines = NULL;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_NULL_POINTER, "config.lines");
    REQUIRE(stream == NULL);
    REFUSED(gnp_stream_push(NULL, 0.0, &track, 1, &result), GNP_STATUS_NULL_POINTER, "stream");
    REFUSED(gnp_stream_set_lines(NULL, LINES, 3), GNP_STATUS_NULL_POINTER, "stream");
    REFUSED(gnp_stream_reset(NULL), GNP_STATUS_NULL_POINTER, "stream");
    config = usual();
    REQUIRE(gnp_stream_new(model, &config, &stream) == GNP_STATUS_OK);
    REFUSED(gnp_stream_push(stream, 0.0, NULL, 1, &result), GNP_STATUS_NULL_POINTER, "tracks");
    REFUSED(gnp_stream_push(stream, 0.0, &track, 1, NULL), GNP_STATUS_NULL_POINTER, "result");
    REFUSED(gnp_stream_push(stream, 0.0, &track, SIZE_MAX, &result), GNP_STATUS_INVALID_ARGUMENT, "tracks");
    REQUIRE(gnp_stream_push(stream, 0.0, NULL, 0, &result) == GNP_STATUS_OK && result.vehicle_count == 0);
    gnp_stream_free(stream);
    gnp_stream_free(NULL);
    gnp_model_free(none);
}

static void unknown_models(void) {
    GnpModel *model = (GnpModel *)&model; /* not NULL */
    REFUSED(gnp_model_load("no/such/model", &model), GNP_STATUS_MODEL, "no/such/model");
    REQUIRE(model == NULL);
    REFUSED(gnp_model_load("", &model), GNP_STATUS_MODEL, "");
    REFUSED(gnp_model_load("\xff\xfe", &model), GNP_STATUS_INVALID_ARGUMENT, "UTF-8");
}

static void bad_configurations(const GnpModel *model) {
    GnpStream *stream = NULL;
    const GnpPoint single[] = {{0.0, 0.0}};
    const GnpLine feet[] = {{0.0f, 1}, {12.0f, 1}}, backwards[] = {{3.0f, 1}, {0.0f, 1}}, unlike[] = {{0.0f, 1}, {3.0f, 2}};
    GnpStreamConfig config = usual();
    config.line_count = 0;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "lines");
    config = usual();
    config.line_count = 2;
    config.lines = feet;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "feet");
    config.lines = backwards;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "right to left");
    config.lines = unlike;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "edge");
    config = usual();
    config.modes = 0;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "k is 0");
    config = usual();
    config.coast_s = NAN;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "coast_s");
    config = usual();
    config.forces = 7;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "forces");
    config = usual();
    config.road = single;
    config.road_count = 1;
    REFUSED(gnp_stream_new(model, &config, &stream), GNP_STATUS_INVALID_ARGUMENT, "road");
    REQUIRE(stream == NULL);
}

static void bad_frames(const GnpModel *model) {
    GnpStream *stream = NULL;
    GnpStreamConfig config = usual();
    GnpResult result;
    config.forces = 1;
    config.max_vehicles = 8;
    REQUIRE(gnp_stream_new(model, &config, &stream) == GNP_STATUS_OK);
    /* Uneven times, and vehicle 2 away for half a second. */
    for (int i = 0; i <= 60; i++) {
        const double time = 0.05 * i + (i % 2 ? 0.011 : 0.0);
        const GnpTrack tracks[] = {car(1, 20.0 * time, -1.8, 20.0f), car(2, 40.0 + 18.0 * time, -1.7, 18.0f)};
        REQUIRE(gnp_stream_push(stream, time, tracks, i > 30 && i < 40 ? 1 : 2, &result) == GNP_STATUS_OK);
        require_finite(&result);
    }
    REQUIRE(result.vehicle_count == 2 && result.forecast_count == 2 && result.problem_count == 0);
    REQUIRE(result.vehicles[1].validity == GNP_VALIDITY_INTERPOLATED && result.vehicles[1].gap_s > 0.4);
    REQUIRE(result.mode_count == 6 && result.step_count > 1 && result.term_count > 1);

    const GnpTrack good = car(1, 62.0, -1.8, 20.0f);
    REFUSED(gnp_stream_push(stream, 3.0, &good, 1, &result), GNP_STATUS_TIME, "after");
    REFUSED(gnp_stream_push(stream, -1.0, &good, 1, &result), GNP_STATUS_TIME, "after");
    REFUSED(gnp_stream_push(stream, NAN, &good, 1, &result), GNP_STATUS_TIME, "finite");
    REFUSED(gnp_stream_push(stream, INFINITY, &good, 1, &result), GNP_STATUS_TIME, "finite");
    GnpTrack wrong = good;
    wrong.kind = 9;
    REFUSED(gnp_stream_push(stream, 3.1, &wrong, 1, &result), GNP_STATUS_INVALID_ARGUMENT, "tracks[0].kind");
    wrong = good;
    wrong.known = 64;
    REFUSED(gnp_stream_push(stream, 3.1, &wrong, 1, &result), GNP_STATUS_INVALID_ARGUMENT, "tracks[0].known");

    /* One bad track does not stop the others. */
    GnpTrack tracks[5] = {good, car(3, NAN, 0.0, 20.0f), good, car(4, 30.0, 1.8, 300.0f), car(5, 90.0, 1.8, 20.0f)};
    tracks[4].length = 4600.0f;
    tracks[4].width = 1.8f;
    tracks[4].known |= GNP_HAS_SIZE;
    REQUIRE(gnp_stream_push(stream, 3.1, tracks, 5, &result) == GNP_STATUS_OK);
    require_finite(&result);
    REQUIRE(result.vehicles[0].id == 1 && result.vehicles[0].forecast >= 0);
    const GnpReason expected[] = {GNP_REASON_POSITION, GNP_REASON_DUPLICATE, GNP_REASON_VELOCITY, GNP_REASON_SIZE};
    REQUIRE(result.problem_count == 4);
    for (size_t i = 0; i < 4; i++) {
        REQUIRE(result.problems[i].reason == expected[i] && result.problems[i].row == i + 1);
        REQUIRE(strlen(gnp_reason_text(result.problems[i].reason)) > 10);
    }
    /* Vehicle 4 has one position and no velocity. */
    for (size_t i = 0; i < result.vehicle_count; i++) {
        if (result.vehicles[i].id == 4) {
            REQUIRE(result.vehicles[i].reason == GNP_REASON_NO_VELOCITY);
        }
    }

    /* More vehicles than there is room for. */
    enum { MANY = 10000 };
    GnpTrack *many = calloc(MANY, sizeof *many);
    REQUIRE(many != NULL);
    for (size_t i = 0; i < MANY; i++) {
        many[i] = car(100 + i, 10.0 * (double)i, 1.8, 20.0f);
    }
    REQUIRE(gnp_stream_reset(stream) == GNP_STATUS_OK);
    REQUIRE(gnp_stream_push(stream, 0.0, many, MANY, &result) == GNP_STATUS_OK);
    require_finite(&result);
    REQUIRE(result.vehicle_count == 8 && result.problem_count == MANY - 8);
    REQUIRE(result.problems[0].reason == GNP_REASON_CAPACITY);
    free(many);

    REFUSED(gnp_stream_set_lines(stream, LINES, 1), GNP_STATUS_INVALID_ARGUMENT, "lines");
    REQUIRE(gnp_stream_set_lines(stream, LINES, 3) == GNP_STATUS_OK);
    gnp_stream_free(stream);
}

static void along_a_bend(const GnpModel *model) {
    /* A quarter of a circle with a radius of 600 m, driven along 1.8 m to the left of its line. */
    enum { POINTS = 101 };
    const double radius = 600.0, quarter = 1.5707963267948966;
    GnpPoint road[POINTS];
    for (int i = 0; i < POINTS; i++) {
        const double angle = quarter * i / (POINTS - 1);
        road[i].x = radius * sin(angle);
        road[i].y = radius * (1.0 - cos(angle));
    }
    GnpStreamConfig config = usual();
    config.road = road;
    config.road_count = POINTS;
    config.modes = 1;
    GnpStream *stream = NULL;
    GnpResult result;
    REQUIRE(gnp_stream_new(model, &config, &stream) == GNP_STATUS_OK);
    memset(road, 0, sizeof road); /* the stream has its own copy */
    for (int i = 0; i <= 40; i++) {
        const double angle = 0.1 + 25.0 * 0.1 * i / radius;
        GnpTrack track = car(1, (radius - 1.8) * sin(angle), radius - (radius - 1.8) * cos(angle), 0.0f);
        track.vx = 25.0f * (float)cos(angle);
        track.vy = 25.0f * (float)sin(angle);
        REQUIRE(gnp_stream_push(stream, 0.1 * i, &track, 1, &result) == GNP_STATUS_OK);
    }
    require_finite(&result);
    REQUIRE(result.forecast_count == 1 && result.vehicles[0].validity == GNP_VALIDITY_FULL);
    /* Who drives freely stays on the road. */
    const double *end = result.paths + 2 * (result.step_count - 1);
    REQUIRE(fabs(hypot(end[0], end[1] - radius) - (radius - 1.8)) < 1.5);
    const GnpTrack off = car(2, -500.0, 900.0, 20.0f);
    REQUIRE(gnp_stream_push(stream, 4.1, &off, 1, &result) == GNP_STATUS_OK);
    REQUIRE(result.problem_count == 1 && result.problems[0].reason == GNP_REASON_OFF_ROAD);
    gnp_stream_free(stream);
}

/* A stream of its own on a shared model; the last x of its prediction. */
static void *one_stream(void *argument) {
    const GnpModel *model = argument;
    REQUIRE(strcmp(gnp_last_error(), "") == 0); /* errors of other threads stay with them */
    const GnpStreamConfig config = usual();
    GnpStream *stream = NULL;
    GnpResult result;
    REQUIRE(gnp_stream_new(model, &config, &stream) == GNP_STATUS_OK);
    for (int i = 0; i <= 40; i++) {
        const GnpTrack tracks[] = {car(1, 2.5 * i, -1.8, 25.0f), car(2, 30.0 + 2.0 * i, -1.8, 20.0f)};
        REQUIRE(gnp_stream_push(stream, 0.1 * i, tracks, 2, &result) == GNP_STATUS_OK);
    }
    double *end = malloc(sizeof *end);
    REQUIRE(end != NULL);
    *end = result.paths[2 * (result.step_count - 1)];
    REFUSED(gnp_stream_push(stream, 0.0, NULL, 0, &result), GNP_STATUS_TIME, "after");
    gnp_stream_free(stream);
    return end;
}

static void threads(const GnpModel *model) {
    enum { THREADS = 4 };
    pthread_t thread[THREADS];
    double first = 0.0;
    for (int i = 0; i < THREADS; i++) {
        REQUIRE(pthread_create(&thread[i], NULL, one_stream, (void *)model) == 0);
    }
    for (int i = 0; i < THREADS; i++) {
        void *end = NULL;
        REQUIRE(pthread_join(thread[i], &end) == 0);
        first = i == 0 ? *(double *)end : first;
        REQUIRE(*(double *)end == first);
        free(end);
    }
}

int main(void) {
    REQUIRE(gnp_interface() == GNP_INTERFACE && strlen(gnp_version()) > 0);
    REQUIRE(strcmp(gnp_last_error(), "") == 0);
    REQUIRE(strlen(gnp_reason_text(12345)) > 0);
    GnpModel *model = NULL;
    GnpModelInfo info;
    REQUIRE(gnp_model_load(NULL, &model) == GNP_STATUS_OK);
    REQUIRE(gnp_model_info(model, &info) == GNP_STATUS_OK);
    REQUIRE(info.rate_hz > 0.0 && info.observed_s > 0.0 && info.predicted_s > 0.0);
    null_pointers(model);
    unknown_models();
    bad_configurations(model);
    bad_frames(model);
    along_a_bend(model);
    threads(model);

    /* A stream outlives its model. */
    GnpStream *stream = NULL;
    GnpResult result;
    const GnpStreamConfig config = usual();
    const GnpTrack track = car(1, 0.0, 1.8, 20.0f);
    REQUIRE(gnp_stream_new(model, &config, &stream) == GNP_STATUS_OK);
    gnp_model_free(model);
    REQUIRE(gnp_stream_push(stream, 0.0, &track, 1, &result) == GNP_STATUS_OK);
    REQUIRE(result.forecast_count == 1 && result.vehicles[0].validity == GNP_VALIDITY_FILLED);
    gnp_stream_free(stream);
    return EXIT_SUCCESS;
}
