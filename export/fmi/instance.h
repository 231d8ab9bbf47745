/* An instance of a model in an FMU: what fmi2.c and fmi3.c share.

   variables.h, which is made for every model, has the model's names, the numbers of its inputs
   and degrees of freedom, and where each variable lies in `values`. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "variables.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Set a variable. Inputs jump, once outputs are read or a step begins; 0 where there is none. */
static int set_value(values *v, unsigned int reference, double value)
{
    if (reference >= VARIABLES || (reference >= FIRST_OUTPUT && reference < FIRST_PARAMETER)) {
        return 0;
    }
    *(double *)((char *)v + PLACES[reference]) = value;
    if (reference < FIRST_OUTPUT) {
        v->jumps = 1;
    }
    return 1;
}

static void jump(values *v)
{
    if (v->jumps) {
        MODEL_EXCITE(&v->own, v->input);
        v->jumps = 0;
    }
}

/* A variable; *found is 0 where there is none. */
static double get_value(values *v, unsigned int reference, int *found)
{
    if (reference >= VARIABLES) {
        *found = 0;
        return 0.0;
    }
    if (v->begun) {
        jump(v);
    }
    return *(double *)((char *)v + PLACES[reference]);
}

/* Numbers that were identified, at rest. */
static void start_anew(values *v)
{
    memset(v, 0, sizeof *v);
    MODEL_INIT(&v->own);
}

static void begin_motion(values *v)
{
    MODEL_BEGIN(&v->own, v->x0, v->v0, v->input);
    v->jumps = 0;
    v->begun = 1;
}

/* A step in which inputs change by their slopes; what it says is that of the model. */
static int go_on(values *v, double step)
{
    double end[INPUTS > 0 ? INPUTS : 1];
    int i, said;

    jump(v);
    end[0] = 0.0;
    for (i = 0; i < INPUTS; ++i) {
        end[i] = v->input[i] + v->slope[i] * step;
        if (v->slope[i] != 0.0) {
            v->jumps = 1;
        }
    }
    said = MODEL_STEP(&v->own, end, step);
    for (i = 0; i < INPUTS; ++i) {
        v->input[i] = end[i];
    }
    v->jumps = 0;
    return said;
}

static void tell_fault(char *text, size_t size, int said, double step)
{
    if (said == MODEL_DIVERGED) {
        snprintf(text, size, "the motion has diverged; lower the excitation");
    } else {
        snprintf(text, size, "the communication step of %g s must be a multiple of %g s", step,
                 MODEL_DT);
    }
}

#endif
