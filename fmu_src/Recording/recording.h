/* A recording of two rows, so that the model builds by itself; build_fmus.recording_fmu() puts another in its place. */
#define ROWS 2
#define COLUMNS 1
#define UNIFORM 1
#define TIME_FIRST 0x0000000000000000
#define TIME_STEP 0x3ff0000000000000
static const uint64_t times[] = {0};
static const uint64_t data[] = {
    0x0000000000000000,
    0x3ff0000000000000,
};
