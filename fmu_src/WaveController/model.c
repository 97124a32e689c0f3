/* Wave variables with matched impedance and wave filter (Niemeyer and Slotine), README.md and law.h. */
#include "law.h"

static void derivatives(Model *m, double t) {
    double rates[WAVE_STATES];
    (void)t;
    wave_rates(m, WaveController_STATE(m), rates);
    memcpy(m->der_error, rates, sizeof m->der_error);
    memcpy(m->der_filtered, rates + 3, sizeof m->der_filtered);
}

static void outputs(Model *m, double t) {
    (void)t;
    wave_outputs(m);
}
