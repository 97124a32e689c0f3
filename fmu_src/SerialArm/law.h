/* The law of a serial arm, in `real`, on the struct that model.toml gives: one source for FMU and sweeps'
 * vector lanes.
 *
 *   M(q) ddq + C(q, dq) dq + N(q) + friction + required = tau_motor + J' (f + f_contact)
 *   tau_motor = limit(deadband((1 + gain) (tau + J' (f_command + f_device) + N_nominal)))
 *
 * Commands that are late model.c puts in. Rigid body: serial.h; equations and sources:
 * README.md. How many joints there are, of which type, and which of them others move is the same in all lanes.
 */
#ifndef SERIAL_ARM_LAW_H
#define SERIAL_ARM_LAW_H

#include "../shared/domain.h"
#include "../shared/joint.h"
#include "serial.h"

#define SERIAL_ROOM                                                                                                    \
    ((int)(sizeof((SerialArmModel *)0)->q_start / sizeof(real))) /* rows; the joints are the first of them */

/* Joints that are there; the range of `joints` again, so that a compiler knows it. */
static inline int serial_count(const SerialArmModel *m) {
    const int n = (int)LANE(m->joints, 0);
    return n < 1 ? 1 : n > SERIAL_ROOM ? SERIAL_ROOM : n;
}

static inline const SerialLink *serial_links(const SerialArmModel *m) {
    return (const SerialLink *)m->links;
}
typedef char serial_links_fit[sizeof((SerialArmModel *)0)->bare == sizeof(SerialLink) ? 1 : -1];

/* Whether a number of any lane is not zero. */
static inline int serial_has(const real *values, int n) {
    mask has = nowhere();
    for (int i = 0; i < n; i++) has = has | (values[i] != 0.0);
    return any(has);
}

/* Joint i, with what an elastic one was not given; in lanes without the marks of what is there. */
static inline Joint serial_joint(const SerialArmModel *m, int i) {
    Joint j;
#define JOINT_FIELD(name) j.name = m->name[i];
    JOINT_PARAMETERS(JOINT_FIELD)
#undef JOINT_FIELD
    j.present = 0;
    j.motor_inertia = choose(j.motor_inertia > 0.0, j.motor_inertia, m->armature[i]);
    joint_complete(&j, m->start_inertia[i]);
    return j;
}

/* --- start -------------------------------------------------------------------------------------------------------- */

/* The payload on the last link where there is one. */
static inline void serial_set_payload(SerialArmModel *m, SerialLink *last) {
    const mask there = m->payload > 0.0;
    if (!any(there)) return;
    real *const bare = m->bare, *const whole = (real *)last;
    serial_add_mass(last, m->payload, m->offset);
    for (int k = 0; k < SERIAL_LINK_REALS; k++) whole[k] = choose(there, whole[k], bare[k]);
}

/* The links in frames turned to their axes, the payload on the last one, the tip, what motors add to M. */
static inline void serial_set_body(SerialArmModel *m) {
    SerialLink *link = (SerialLink *)m->links;
    const int n = serial_count(m);
    const real one = real_of(1.0), none = real_of(0.0);
    real turned[9] = {one, none, none, none, one, none, none, none, one};
    for (int i = 0; i < SERIAL_ROOM; i++) m->kinds[i] = LANE(m->joint_type[i], 0);
    for (int i = 0; i < n; i++) {
        const SerialRow row = {
            {m->origin_x[i], m->origin_y[i], m->origin_z[i]},
            {m->origin_roll[i], m->origin_pitch[i], m->origin_yaw[i]},
            {m->axis_x[i], m->axis_y[i], m->axis_z[i]},
            m->mass[i],
            {m->centre_x[i], m->centre_y[i], m->centre_z[i]},
            {m->inertia_xx[i], m->inertia_xy[i], m->inertia_xz[i], m->inertia_yy[i], m->inertia_yz[i],
             m->inertia_zz[i]},
        };
        serial_link(&row, turned, &link[i]);
        m->armature[i] = m->link_armature[i] = m->rotor_inertia[i] * (m->gear_ratio[i] * m->gear_ratio[i]);
    }
    turn_back(turned, m->tip, m->offset);
    memcpy(m->bare, &link[n - 1], sizeof m->bare);
    serial_set_payload(m, &link[n - 1]);
}

/* The vertical leans by a towards x and by b towards y: gravity turned by Rx(-b) Ry(a). */
static inline void serial_set_gravity(SerialArmModel *m) {
    const real lean[3] = {-m->base_tilt[1], m->base_tilt[0], real_of(0.0)};
    real s[3], c[3];
    sincos_each(3, lean, s, c);
    const real *g = m->gravity, x = c[1] * g[0] + s[1] * g[2], z = c[1] * g[2] - s[1] * g[0];
    m->pull[0] = x;
    m->pull[1] = c[0] * g[1] - s[0] * z;
    m->pull[2] = s[0] * g[1] + c[0] * z;
}

/* The unit normal of the undeclared wall; zero where it has no direction. */
static inline void serial_set_wall(SerialArmModel *m) {
    direction_of(m->contact_normal, m->wall);
    m->walled = any(m->contact_stiffness > 0.0);
}

/* At q_start with dq_start, at rest in all else, inside the domain; what any lane has, so that the rest is not computed. */
static inline void serial_start(SerialArmModel *m) {
    const int n = serial_count(m);
    real *const states = SerialArm_STATE(m);
    for (int i = 0; i < SerialArm_STATES; i++) states[i] = real_of(0.0);
    for (int i = 0; i < SERIAL_ROOM; i++) {
        m->q_link[i] = m->q_motor[i] = m->q_start[i];
        m->dq_link[i] = m->dq_motor[i] = m->dq_start[i];
    }
    m->domain = real_of(1.0);
    m->indefinite = real_of(0.0);
    serial_set_body(m);
    serial_set_gravity(m);
    serial_set_wall(m);
    m->impedance = serial_has(m->stiffness, 3) || serial_has(m->damping, 3);
    m->compensated = any(m->gravity_compensation != 0.0);
    m->rubs = serial_has(m->coulomb, n);
    m->coupled = serial_has(m->coupling_on, SERIAL_ROOM);
}

/* Where the arm is inside its domain. */
static inline void serial_keep(SerialArmModel *m) {
    memcpy(m->kept, SerialArm_STATE(m), sizeof m->kept);
}

/* --- the arm at a pose -------------------------------------------------------------------------------------------- */

static inline void serial_look(const SerialArmModel *m, const real *q, SerialPose *pose, SerialTip *tip) {
    const int n = serial_count(m);
    serial_pose(n, m->kinds, serial_links(m), q, pose);
    serial_tip(n, m->kinds, pose, m->offset, tip);
}

/* Whether in any lane a force acts on the tip or is commanded there: without one the tip need not be known. */
static inline int serial_feels_tip(const SerialArmModel *m) {
    return m->impedance != 0 || m->walled != 0 || serial_has(m->f, 3) || serial_has(m->f_command, 3);
}

/* N(q) of the table where the arm compensates it: no payload, no tilt (N m). */
static inline void serial_nominal_gravity(const SerialArmModel *m, const SerialPose *pose, real *torque) {
    const int n = serial_count(m);
    const mask compensated = m->gravity_compensation != 0.0;
    serial_weight(n, m->kinds, serial_links(m), (const SerialLink *)m->bare, pose, m->gravity, torque);
    for (int i = 0; i < n; i++) torque[i] = choose(compensated, torque[i], real_of(0.0));
}

/* --- torques ------------------------------------------------------------------------------------------------------ */

/* torque = tau + J' f_command (N m). No tip: no f_command. */
static inline void serial_command(const SerialArmModel *m, const SerialTip *tip, real *torque) {
    for (int i = 0; i < serial_count(m); i++)
        torque[i] = tip ? m->tau[i] + dot(tip->column[i], m->f_command) : m->tau[i];
}

/* What the device adds to its commands: J' (stiffness (x_ref - x) - damping dx), then `weight`, the nominal gravity (N m). */
static inline void serial_add_own_command(const SerialArmModel *m, const SerialTip *tip, const real *dq,
                                          const real *weight, real *torque) {
    const int n = serial_count(m);
    if (m->impedance != 0) {
        real dx[3], force[3], own[SERIAL_MOST];
        serial_velocity(n, tip, dq, dx);
        for (int k = 0; k < 3; k++) force[k] = m->stiffness[k] * (m->x_ref[k] - tip->x[k]) - m->damping[k] * dx[k];
        serial_torque_of_force(n, tip, force, own);
        for (int i = 0; i < n; i++) torque[i] = torque[i] + own[i];
    }
    for (int i = 0; i < n && m->compensated != 0; i++) torque[i] = torque[i] + weight[i];
}

/* friction = viscous dq + coulomb s(dq) (N m), taken from `torque`: all that a plain joint has. */
static inline void serial_take_friction(const SerialArmModel *m, const real *dq, real *torque) {
    for (int i = 0; i < serial_count(m); i++) {
        const real fc = m->coulomb[i], v = m->coulomb_velocity[i], viscous = m->viscous[i] * dq[i];
        real friction = viscous;
        if (m->rubs != 0)
            friction = choose(fc != 0.0, viscous + fc * (dq[i] / real_sqrt(dq[i] * dq[i] + v * v)), viscous);
        torque[i] = torque[i] - friction;
    }
}

/* Required torques from the motion of other joints (N m). present: marks of what is there. */
static inline void serial_coupling(const SerialArmModel *m, uint64_t present, const real *q, const real *dq,
                                   real *required) {
    for (int i = 0; i < serial_count(m); i++) required[i] = real_of(0.0);
    for (int k = 0; k < SERIAL_ROOM; k++) {
        const int i = (int)LANE(m->coupling_on[k], 0) - 1, from = (int)LANE(m->coupling_from[k], 0) - 1;
        if (i < 0) continue;
        const real v = m->coupling_velocity[k], level = m->coupling_coulomb[k], u = dq[from];
        real sum = m->coupling_viscous[k] * u + m->coupling_stiffness[k] * q[from];
        if (any(level != 0.0)) {
            Joint other = serial_joint(m, from);
            other.present = present;
            const real sign = choose(v > 0.0, u / real_sqrt(u * u + v * v), joint_sign(&other, u));
            sum = choose(level != 0.0, sum + level * sign, sum);
        }
        required[i] = required[i] + sum;
    }
}

/* f = -n max(0, k (n . x - distance) + c n . dx) where n . x > distance: the wall pushes, never pulls (N). */
static inline void serial_contact_force(const SerialArmModel *m, const SerialTip *tip, const real *dq, real force[3]) {
    const real none = real_of(0.0);
    real dx[3];
    serial_velocity(serial_count(m), tip, dq, dx);
    const real depth = dot(m->wall, tip->x) - m->contact_distance;
    const mask touches = (m->contact_stiffness > 0.0) & (depth > 0.0);
    const real push = choose(touches, m->contact_stiffness * depth + m->contact_damping * dot(m->wall, dx), none);
    for (int k = 0; k < 3; k++) force[k] = choose(push > 0.0, -push * m->wall[k], none);
}

/* J' (f + f_contact), added to `torque` (N m). */
static inline void serial_add_outside(const SerialArmModel *m, const SerialTip *tip, const real *dq, real *torque) {
    real force[3] = {m->f[0], m->f[1], m->f[2]}, outside[SERIAL_MOST];
    if (m->walled != 0) {
        real contact[3];
        serial_contact_force(m, tip, dq, contact);
        for (int k = 0; k < 3; k++) force[k] = contact[k] + m->f[k];
    }
    serial_torque_of_force(serial_count(m), tip, force, outside);
    for (int i = 0; i < serial_count(m); i++) torque[i] = torque[i] + outside[i];
}

/* --- motion ------------------------------------------------------------------------------------------------------- */

/* ddq of the torques on the links, 0 where M is not positive definite, which is noted. */
static inline void serial_respond(SerialArmModel *m, const SerialPose *pose, const real *dq, const real *torque,
                                  real *ddq) {
    const int n = serial_count(m);
    const mask definite =
        serial_forward(n, m->kinds, serial_links(m), pose, m->link_armature, m->pull, dq, torque, ddq);
    if (all(definite)) return;
    m->indefinite = choose(definite, m->indefinite, real_of(1.0));
    for (int i = 0; i < n; i++) ddq[i] = choose(definite, ddq[i], real_of(0.0));
}

/* Where M is positive definite. */
static inline mask serial_definite_at_rest(const SerialArmModel *m, const SerialPose *pose) {
    real rest[SERIAL_MOST], ddq[SERIAL_MOST];
    for (int i = 0; i < SERIAL_MOST; i++) rest[i] = real_of(0.0);
    return serial_forward(serial_count(m), m->kinds, serial_links(m), pose, m->link_armature, rest, rest, rest, ddq);
}

/* Fastest rate of the in-device impedance at a pose (1/s): per axis, with W = J M^-1 J', damping W_ii or
 * sqrt(stiffness W_ii); 0 where there is none. */
static inline real serial_impedance_rate(const SerialArmModel *m, const SerialPose *pose, const SerialTip *tip) {
    const int n = serial_count(m);
    const real none = real_of(0.0);
    real rest[SERIAL_MOST], torque[SERIAL_MOST], ddq[SERIAL_MOST], ddx[3], fastest = none;
    for (int i = 0; i < SERIAL_MOST; i++) rest[i] = none;
    for (int k = 0; k < 3 && m->impedance != 0; k++) {
        real force[3] = {none, none, none};
        force[k] = real_of(1.0);
        serial_torque_of_force(n, tip, force, torque);
        serial_forward(n, m->kinds, serial_links(m), pose, m->link_armature, rest, rest, torque, ddq);
        serial_velocity(n, tip, ddq, ddx);
        const real rate = real_max(m->damping[k] * ddx[k], real_sqrt(m->stiffness[k] * real_max(ddx[k], none)));
        fastest = real_max(fastest, rate);
    }
    return fastest;
}

/* Diagonal of M at a pose: the torque of a unit acceleration (kg m^2). */
static inline void serial_set_start_inertia(SerialArmModel *m, const SerialPose *pose) {
    const int n = serial_count(m);
    real rest[SERIAL_MOST], unit[SERIAL_MOST], torque[SERIAL_MOST];
    for (int i = 0; i < SERIAL_MOST; i++) rest[i] = real_of(0.0);
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < n; k++) unit[k] = real_of(k == i ? 1.0 : 0.0);
        serial_inverse(n, m->kinds, serial_links(m), pose, m->armature, rest, rest, unit, torque);
        m->start_inertia[i] = torque[i];
    }
}

/* Which joints are elastic: their motors move on their own. */
static inline void serial_set_motors(SerialArmModel *m) {
    for (int i = 0; i < serial_count(m); i++) {
        const Joint j = serial_joint(m, i);
        const mask elastic = j.joint_compliance > 0.0;
        m->elastic[i] = real_of_mask(elastic);
        m->link_armature[i] = choose(elastic, m->armature[i] - j.motor_inertia, m->armature[i]);
    }
}

/* Angle and velocity on the encoder's side: the motor's where the joint is elastic. */
static inline real serial_motor_side(const SerialArmModel *m, int i, real motor, real link) {
    return choose(m->elastic[i] != 0.0, motor, link);
}

/* The domain: M positive definite along the motion, `n` states that are below their limit, and the joint limits where they are
 * asked for. Outside, those states are again what they were at the last communication point inside, and stay it. */
static inline void serial_stay_inside(SerialArmModel *m, int n) {
    real *const states = SerialArm_STATE(m);
    const mask free = m->joint_limits == 0.0;
    mask inside = (m->domain != 0.0) & (m->indefinite == 0.0) & states_within(states, n);
    for (int i = 0; i < serial_count(m) && !all(free); i++)
        inside = inside & (free | (m->lower[i] >= m->upper[i]) |
                           ((m->q_link[i] >= m->lower[i]) & (m->q_link[i] <= m->upper[i])));
    m->domain = real_of_mask(inside);
    for (int i = 0; i < n && !all(inside); i++) states[i] = choose(inside, states[i], m->kept[i]);
    for (int i = 0; i < n; i++) m->kept[i] = states[i];
}

#endif
