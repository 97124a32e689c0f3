/* Components at work in all lanes: their models, what Python says of them, what they remember. */
#ifndef PART_H
#define PART_H

#include <stddef.h>
#include <stdint.h>

#define JOINT_IN_LANES

/* Laws work in registers: every function that is inline is put where it is called, whatever the compiler thinks of its size. */
#ifdef __clang__ /* which zig is; gcc builds the kernel only to check it, and takes minutes for so large functions */
#pragma clang diagnostic ignored "-Wkeyword-macro"
#define inline inline __attribute__((always_inline))
#endif

#include "AdaptiveController_model.h"
#include "ArmController_model.h"
#include "Environment_model.h"
#include "FourChannelController_model.h"
#include "InverseDynamicsController_model.h"
#include "ModelMediatedController_model.h"
#include "Operator_model.h"
#include "PDController_model.h"
#include "PDLikeController_model.h"
#include "PLikeController_model.h"
#include "PacketChannel_model.h"
#include "PassivityController_model.h"
#include "PhantomArm_model.h"
#include "PositionForceController_model.h"
#include "SerialArm_model.h"
#include "TwoLayerController_model.h"
#include "VariableDelayChannel_model.h"
#include "WaveController_model.h"

#include "../AdaptiveController/law.h"
#include "../ArmController/law.h"
#include "../Environment/law.h"
#include "../FourChannelController/law.h"
#include "../InverseDynamicsController/law.h"
#include "../ModelMediatedController/law.h"
#include "../Operator/law.h"
#include "../PDController/law.h"
#include "../PDLikeController/law.h"
#include "../PLikeController/law.h"
#include "../PassivityController/law.h"
#include "../PhantomArm/law.h"
#include "../PositionForceController/law.h"
#include "../SerialArm/law.h"
#include "../TwoLayerController/law.h"
#include "../VariableDelayChannel/law.h"
#include "../WaveController/law.h"
#include "../shared/layout.h"

#define ARM_EFFECT_STATES 15 /* q_link, dq_link, z, z_short, z_long */
#define SERIAL_STATE_KINDS 8 /* likewise, and tau_lag, q_motor, dq_motor, a row of each */
#define MOST_STATES (SERIAL_STATE_KINDS * SERIAL_MOST)
#include "../shared/runge_kutta.h"

enum {
    ARM,
    CONTROLLER,
    CHANNEL,
    OPERATOR,
    ENVIRONMENT,
    ARM_CONTROLLER,
    PACKET_CHANNEL,
    SERIAL_ARM,
    PD_LIKE,
    POSITION_FORCE,
    FOUR_CHANNEL,
    WAVE,
    PASSIVITY,
    TWO_LAYER,
    MODEL_MEDIATED,
    ADAPTIVE,
    PD,
    INVERSE_DYNAMICS,
    SERIES
};

/* A model: its variables by their value references, their start values, and the vectors that the store holds
 * of them; none: all of their outputs. */
static const struct {
    const char *name;
    int64_t n_values;
    const double *start;
    const char *held;
} models[] = {{"PhantomArm", PhantomArm_VALUES, PhantomArm_START, "q_link dq_link x_tip dx_tip saturated f_contact"},
              {"PLikeController", PLikeController_VALUES, PLikeController_START, "f tau"},
              {"VariableDelayChannel", VariableDelayChannel_VALUES, VariableDelayChannel_START, "y w"},
              {"Operator", Operator_VALUES, Operator_START, "f"},
              {"Environment", Environment_VALUES, Environment_START, "f"},
              {"ArmController", ArmController_VALUES, ArmController_START, "f tau"},
              {"PacketChannel", PacketChannel_VALUES, PacketChannel_START, "y"},
              {"SerialArm", SerialArm_VALUES, SerialArm_START, "q dq x dx x_tip dx_tip tau_motor f_contact saturated"},
              {"PDLikeController", PDLikeController_VALUES, PDLikeController_START, ""},
              {"PositionForceController", PositionForceController_VALUES, PositionForceController_START, ""},
              {"FourChannelController", FourChannelController_VALUES, FourChannelController_START, ""},
              {"WaveController", WaveController_VALUES, WaveController_START, ""},
              {"PassivityController", PassivityController_VALUES, PassivityController_START, ""},
              {"TwoLayerController", TwoLayerController_VALUES, TwoLayerController_START, ""},
              {"ModelMediatedController", ModelMediatedController_VALUES, ModelMediatedController_START, ""},
              {"AdaptiveController", AdaptiveController_VALUES, AdaptiveController_START, ""},
              {"PDController", PDController_VALUES, PDController_START, ""},
              {"InverseDynamicsController", InverseDynamicsController_VALUES, InverseDynamicsController_START, ""},
              {NULL, 0, NULL, NULL}};

/* clang-format off */

/* A component of the scenario, which steps once in every communication step; NULL where the kind has none. Inputs are
 * numbered by their value references. */
#define COMPONENT(FIELD) \
    FIELD(int64_t, kind) \
    FIELD(int64_t, n_inputs)  FIELD(const int64_t *, inputs)  /* those that are wired */ \
    FIELD(int64_t, n_outputs)   /* that the store holds; SERIES: numbers in a row */ \
    FIELD(int64_t, first)       /* place of its first output in half a store */ \
    FIELD(const int64_t *, outputs) /* controllers: numbers of their outputs */ \
    FIELD(int64_t, n_starts) FIELD(const int64_t *, started) FIELD(const real *, starts) /* instead of the table's */ \
    FIELD(const double *const *, series) /* CHANNEL: [LANES] delay at steps 0..n, infinite where a packet is lost; SERIES: [LANES][n + 1][n_outputs] */ \
    FIELD(const int64_t *, series_step)  /* [LANES] 1, or 0 where the series is one constant row */ \
    FIELD(double *, history)  /* CHANNEL: [LANES][capacity][n_inputs], wired inputs only, as rows.h has it */ \
    FIELD(double *, stamps)   /* CHANNEL: [capacity] */ \
    FIELD(int64_t, capacity)  /* a power of two, above the longest delay in steps + 4 */ \
    FIELD(real *, packets)    /* CHANNEL of packets: [3 capacity + 1], see packets.h; NULL: time delays */ \
    FIELD(void *, serial)     /* SERIAL_ARM: serial_size() bytes */

/* Wired inputs that follow one another, numbered by their value references: `n` from `to` on, held at as many places of the
 * store, or from there along lines through the places `older` and `newer`, `span` seconds apart. */
#define WIRE(FIELD) \
    FIELD(int64_t, n) FIELD(int64_t, to) \
    FIELD(int64_t, source) FIELD(int64_t, newer) FIELD(int64_t, older) FIELD(double, span)

/* clang-format on */

LAYOUT(Component, COMPONENT)
LAYOUT(Wire, WIRE)
LAYOUT_SHOWN(Component, COMPONENT)
LAYOUT_SHOWN(Wire, WIRE)

enum { CHANNEL_ROW = 12 }; /* inputs of a channel at most, in fours */

/* A channel's inputs come first among its variables, and its outputs show them in their order. */
#define FIRST_INPUT(model, member) (offsetof(model, member) == 0)
typedef char inputs_come_first[FIRST_INPUT(VariableDelayChannelModel, u) &&
                                       offsetof(VariableDelayChannelModel, v) == 3 * sizeof(real) &&
                                       FIRST_INPUT(PacketChannelModel, u)
                                   ? 1
                                   : -1];

typedef struct SerialPart SerialPart; /* serial_arm.h */

/* A component at work, in all lanes. What is large stands elsewhere, so that the others lie close together. */
typedef struct {
    real *values;       /* the variables of its model by their numbers */
    SerialPart *serial; /* SERIAL_ARM */
    union {
        PhantomArmModel arm;
        PLikeControllerModel controller;
        VariableDelayChannelModel channel;
        PacketChannelModel packets;
        ArmControllerModel arm_controller;
        PDLikeControllerModel pd_like;
        PositionForceControllerModel position_force;
        FourChannelControllerModel four_channel;
        WaveControllerModel wave;
        PassivityControllerModel passivity;
        TwoLayerControllerModel two_layer;
        ModelMediatedControllerModel model_mediated;
        AdaptiveControllerModel adaptive;
        PDControllerModel pd;
        InverseDynamicsControllerModel inverse_dynamics;
        OperatorModel operator_;
        EnvironmentModel environment;
    } model;
    real from[SerialArm_INPUTS], slopes[SerialArm_INPUTS]; /* of what moves: of its inputs along lines */
    const Wire *lines;                                     /* ARM, OPERATOR: [n_lines] */
    int64_t n_lines;
    double moved;     /* ARM: s, how far along */
    double begun;     /* ARM, OPERATOR: s, time of the communication point */
    uint64_t effects; /* ARM: bits by JOINT_PLACE of what any joint of any lane has beside friction */
    int64_t coupled;  /* ARM: whether a joint of any lane feels another one */
    Joint joints[3];  /* ARM: its parameters, joint by joint */
    double sine_at;   /* OPERATOR: s, time of the last of its reference's sines */
    real sine, ahead; /* OPERATOR: it; where all lanes have the same, further sines that they computed side by side */
    EnvironmentNormal normal;      /* ENVIRONMENT: of its wall */
    ArmPose pose;                  /* ARM: of the state */
    real semantics, interpolation; /* CHANNEL */
    int64_t head;                  /* CHANNEL: samples entered; record k stands in slot k & (capacity - 1) */
    /* CHANNEL: record that each lane showed, and stamp and inputs of the next one */
    real_bits at;
    real delay, next_stamp, next[CHANNEL_ROW];
    int64_t known;  /* CHANNEL: whether they are those of record at + 1 in every lane */
    int64_t varies; /* CHANNEL: whether a lane's delay changes; SERIES: whether its numbers do */
    int64_t alike;  /* SERIES, OPERATOR: whether all lanes have the same numbers; the same reference's frequency */
    /* CHANNEL of packets: inputs and stamp of the record shown, stamp of the one sent last */
    real shown[CHANNEL_ROW], shown_stamp, exit;
    int64_t stamped; /* whether any lane needs stamps, that is, shows not the newest packet */
    int64_t sent[LANES],
        following[LANES]; /* if so: the last record sent, and the one sent after that shown (0: none) */
} Part;

static inline real *values_of(Part *a) {
    return a->values;
}

/* Number k of each lane's own numbers. */
static inline real gathered(const double *const *p, int64_t k) {
    real r;
    for (int lane = 0; lane < LANES; lane++) LANE(r, lane) = p[lane][k];
    return r;
}

#endif
