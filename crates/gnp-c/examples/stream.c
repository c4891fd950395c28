/* Three cars on two lanes, a frame every 40 ms: what happens in the next seconds?
 *
 *     cc stream.c -I PREFIX/include -L PREFIX/lib -lgnp_c -o stream && LD_LIBRARY_PATH=PREFIX/lib ./stream
 */
#include <gnp.h>

#include <stdio.h>
#include <stdlib.h>

static void check(GnpStatus status) {
    if (status != GNP_STATUS_OK) {
        fprintf(stderr, "gnp: %s\n", gnp_last_error());
        exit(EXIT_FAILURE);
    }
}

int main(void) {
    GnpModel *model;
    check(gnp_model_load(NULL, &model)); /* the model that is in the library */
    GnpModelInfo info;
    check(gnp_model_info(model, &info));

    const GnpLine lines[] = {{-3.7f, 1}, {0.0f, 0}, {3.7f, 1}};
    GnpStreamConfig config;
    check(gnp_stream_defaults(&config));
    config.lines = lines;
    config.line_count = sizeof lines / sizeof *lines;
    GnpStream *stream;
    check(gnp_stream_new(model, &config, &stream));

    GnpResult result;
    for (int frame = 0; frame <= 100; frame++) {
        const double time = 0.04 * frame;
        /* The second car drives up to the first one. */
        const GnpTrack tracks[] = {
            {.id = 7, .x = 60.0 + 22.0 * time, .y = -1.8, .vx = 22.0f, .known = GNP_HAS_VELOCITY},
            {.id = 8, .x = 10.0 + 28.0 * time, .y = -1.8, .vx = 28.0f, .known = GNP_HAS_VELOCITY},
            {.id = 9, .x = 30.0 + 30.0 * time, .y = 1.9, .vx = 30.0f, .known = GNP_HAS_VELOCITY},
        };
        check(gnp_stream_push(stream, time, tracks, sizeof tracks / sizeof *tracks, &result));
    }

    printf("ends of the paths after %.1f s:\n", info.predicted_s);
    for (size_t i = 0; i < result.vehicle_count; i++) {
        const GnpVehicle *vehicle = &result.vehicles[i];
        if (vehicle->validity == GNP_VALIDITY_NONE) {
            printf("vehicle %llu: %s\n", (unsigned long long)vehicle->id, gnp_reason_text(vehicle->reason));
            continue;
        }
        printf("vehicle %llu at %.1f m:", (unsigned long long)vehicle->id, vehicle->x);
        for (size_t mode = 0; mode < result.mode_count; mode++) {
            const size_t path = (size_t)vehicle->forecast * result.mode_count + mode;
            const double *end = result.paths + 2 * ((path + 1) * result.step_count - 1);
            printf("  (%.1f, %.1f) m %.0f %%", end[0], end[1], 100.0 * (double)result.probabilities[path]);
        }
        printf("\n");
    }

    gnp_stream_free(stream);
    gnp_model_free(model);
    return EXIT_SUCCESS;
}
