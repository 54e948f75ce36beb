/* The C interface of FMI 2.0 for co-simulation, as far as an FMU exports it.
 *
 * The names, their values and their order are those of the standard (FMI 2.0, chapters 2.1 and 4.2), the comments are ours.
 * What belongs to model exchange alone is left out. scripts/check_header.py compares this file item by item with an
 * independent copy of the interface, and scripts/bindings makes bindings.rs from it.
 */
#ifndef FMI2_H
#define FMI2_H

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Types on which the two sides agree. */

/** Return value of fmi2GetTypesPlatform for the types below. */
#define fmi2TypesPlatform "default"
/** Return value of fmi2GetVersion. */
#define fmi2Version "2.0"

/** One instance of the FMU; opaque to the importer. */
typedef void* fmi2Component;
/** A pointer of the importer, passed back with every callback; opaque to the FMU. */
typedef void* fmi2ComponentEnvironment;
/** A snapshot of one instance; opaque to the importer. */
typedef void* fmi2FMUstate;
/** The number that identifies a variable in calls, unique within one base type. */
typedef unsigned int fmi2ValueReference;
/** A value of a Real variable, in the variable's unit. */
typedef double fmi2Real;
/** A value of an Integer or an Enumeration variable. */
typedef int fmi2Integer;
/** A value of a Boolean variable: fmi2True or fmi2False. */
typedef int fmi2Boolean;
/** One byte of a text in UTF-8. */
typedef char fmi2Char;
/** A zero-terminated text in UTF-8; the receiver copies it before the call returns. */
typedef const fmi2Char* fmi2String;
/** One byte of a serialized snapshot. */
typedef char fmi2Byte;

/** The Boolean value true. */
#define fmi2True 1
/** The Boolean value false. */
#define fmi2False 0

/* Enumerations. */

/** How a call ended. */
typedef enum {
    /** All is well. */
    fmi2OK,
    /** Something is unusual; the simulation can continue. */
    fmi2Warning,
    /** The call had no effect; a step was not completed. */
    fmi2Discard,
    /** The instance cannot continue; other instances can. */
    fmi2Error,
    /** No instance of this FMU can continue. */
    fmi2Fatal,
    /** The step was started and will be reported by stepFinished. */
    fmi2Pending
} fmi2Status;

/** The interface type of an instance. */
typedef enum {
    /** The importer integrates the equations. */
    fmi2ModelExchange,
    /** The FMU integrates its own equations. */
    fmi2CoSimulation
} fmi2Type;

/** The query of fmi2GetStatus and its companions. */
typedef enum {
    /** Outcome of the pending step, or fmi2Pending: for fmi2GetStatus. */
    fmi2DoStepStatus,
    /** A text on the pending step: for fmi2GetStringStatus. */
    fmi2PendingStatus,
    /** The time up to which the last step succeeded, in seconds: for fmi2GetRealStatus. */
    fmi2LastSuccessfulTime,
    /** Whether the FMU wants the simulation to end: for fmi2GetBooleanStatus. */
    fmi2Terminated
} fmi2StatusKind;

/* Callbacks of the importer. */

/** Receives a message: environment, instance name, status, category, then a format and its arguments as for printf. */
typedef void (*fmi2CallbackLogger)(fmi2ComponentEnvironment componentEnvironment, fmi2String instanceName,
                                   fmi2Status status, fmi2String category, fmi2String message, ...);
/** Allocates zeroed memory for a number of objects of a size in bytes, or returns a null pointer. */
typedef void* (*fmi2CallbackAllocateMemory)(size_t nobj, size_t size);
/** Frees memory from fmi2CallbackAllocateMemory; a null pointer is allowed. */
typedef void (*fmi2CallbackFreeMemory)(void* obj);
/** Is called when a pending step has ended, with its status. */
typedef void (*fmi2StepFinished)(fmi2ComponentEnvironment componentEnvironment, fmi2Status status);

/** The callbacks and their environment; they live as long as the instance. */
typedef struct {
    /** Receives messages. */
    fmi2CallbackLogger logger;
    /** Allocates memory. */
    fmi2CallbackAllocateMemory allocateMemory;
    /** Frees memory. */
    fmi2CallbackFreeMemory freeMemory;
    /** Is called at the end of a pending step; null if the importer wants no such steps. */
    fmi2StepFinished stepFinished;
    /** Passed back with every message and every end of a step. */
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* Function types, for addresses looked up by importers. */

/** Returns the types platform of the interface. */
typedef const char* fmi2GetTypesPlatformTYPE(void);
/** Returns the version of the standard. */
typedef const char* fmi2GetVersionTYPE(void);
/** Turns messages of the named categories on or off; no categories named means all of them. */
typedef fmi2Status fmi2SetDebugLoggingTYPE(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                                           const fmi2String categories[]);

/** Makes an instance, or returns a null pointer. */
typedef fmi2Component fmi2InstantiateTYPE(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                                          fmi2String fmuResourceLocation, const fmi2CallbackFunctions* functions,
                                          fmi2Boolean visible, fmi2Boolean loggingOn);
/** Frees an instance; a null pointer is allowed. */
typedef void fmi2FreeInstanceTYPE(fmi2Component c);

/** Sets tolerance, start and stop time, in seconds, before initialization. */
typedef fmi2Status fmi2SetupExperimentTYPE(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                                           fmi2Real startTime, fmi2Boolean stopTimeDefined, fmi2Real stopTime);
/** Begins initialization. */
typedef fmi2Status fmi2EnterInitializationModeTYPE(fmi2Component c);
/** Ends initialization; steps may follow. */
typedef fmi2Status fmi2ExitInitializationModeTYPE(fmi2Component c);
/** Ends the simulation; results can still be read. */
typedef fmi2Status fmi2TerminateTYPE(fmi2Component c);
/** Resets an instance to its initial state. */
typedef fmi2Status fmi2ResetTYPE(fmi2Component c);

/** Reads Real variables. */
typedef fmi2Status fmi2GetRealTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Real value[]);
/** Reads Integer variables. */
typedef fmi2Status fmi2GetIntegerTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Integer value[]);
/** Reads Boolean variables. */
typedef fmi2Status fmi2GetBooleanTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2Boolean value[]);
/** Reads String variables; the texts stay valid until the next call on the same instance. */
typedef fmi2Status fmi2GetStringTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, fmi2String value[]);
/** Writes Real variables. */
typedef fmi2Status fmi2SetRealTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr, const fmi2Real value[]);
/** Writes Integer variables. */
typedef fmi2Status fmi2SetIntegerTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                      const fmi2Integer value[]);
/** Writes Boolean variables. */
typedef fmi2Status fmi2SetBooleanTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                      const fmi2Boolean value[]);
/** Writes String variables. */
typedef fmi2Status fmi2SetStringTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                     const fmi2String value[]);

/** Takes a snapshot: a new one if the pointer is null, else into the existing one. */
typedef fmi2Status fmi2GetFMUstateTYPE(fmi2Component c, fmi2FMUstate* FMUstate);
/** Restores a snapshot, which stays valid. */
typedef fmi2Status fmi2SetFMUstateTYPE(fmi2Component c, fmi2FMUstate FMUstate);
/** Frees a snapshot and sets its pointer to null; a null pointer is allowed. */
typedef fmi2Status fmi2FreeFMUstateTYPE(fmi2Component c, fmi2FMUstate* FMUstate);
/** Returns the size of a serialized snapshot, in bytes. */
typedef fmi2Status fmi2SerializedFMUstateSizeTYPE(fmi2Component c, fmi2FMUstate FMUstate, size_t* size);
/** Writes a snapshot as bytes. */
typedef fmi2Status fmi2SerializeFMUstateTYPE(fmi2Component c, fmi2FMUstate FMUstate, fmi2Byte serializedState[],
                                             size_t size);
/** Makes a snapshot from bytes. */
typedef fmi2Status fmi2DeSerializeFMUstateTYPE(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                               fmi2FMUstate* FMUstate);

/** Returns the product of the Jacobian of the unknowns with respect to the knowns and a direction. */
typedef fmi2Status fmi2GetDirectionalDerivativeTYPE(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                                    size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                                    size_t nKnown, const fmi2Real dvKnown[], fmi2Real dvUnknown[]);

/** Sets time derivatives of inputs, of the given orders (1 is the first derivative). */
typedef fmi2Status fmi2SetRealInputDerivativesTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                                   const fmi2Integer order[], const fmi2Real value[]);
/** Reads time derivatives of outputs, of the given orders (1 is the first derivative). */
typedef fmi2Status fmi2GetRealOutputDerivativesTYPE(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                                                    const fmi2Integer order[], fmi2Real value[]);
/** Steps from a time by a step size, both in seconds. */
typedef fmi2Status fmi2DoStepTYPE(fmi2Component c, fmi2Real currentCommunicationPoint,
                                  fmi2Real communicationStepSize, fmi2Boolean noSetFMUStatePriorToCurrentPoint);
/** Cancels a pending step. */
typedef fmi2Status fmi2CancelStepTYPE(fmi2Component c);

/** Answers a query about the step with a status. */
typedef fmi2Status fmi2GetStatusTYPE(fmi2Component c, const fmi2StatusKind s, fmi2Status* value);
/** Answers a query about the step with a Real. */
typedef fmi2Status fmi2GetRealStatusTYPE(fmi2Component c, const fmi2StatusKind s, fmi2Real* value);
/** Answers a query about the step with an Integer. */
typedef fmi2Status fmi2GetIntegerStatusTYPE(fmi2Component c, const fmi2StatusKind s, fmi2Integer* value);
/** Answers a query about the step with a Boolean. */
typedef fmi2Status fmi2GetBooleanStatusTYPE(fmi2Component c, const fmi2StatusKind s, fmi2Boolean* value);
/** Answers a query about the step with a text. */
typedef fmi2Status fmi2GetStringStatusTYPE(fmi2Component c, const fmi2StatusKind s, fmi2String* value);

/* The functions that the FMU exports. */

fmi2GetTypesPlatformTYPE fmi2GetTypesPlatform;
fmi2GetVersionTYPE fmi2GetVersion;
fmi2SetDebugLoggingTYPE fmi2SetDebugLogging;

fmi2InstantiateTYPE fmi2Instantiate;
fmi2FreeInstanceTYPE fmi2FreeInstance;

fmi2SetupExperimentTYPE fmi2SetupExperiment;
fmi2EnterInitializationModeTYPE fmi2EnterInitializationMode;
fmi2ExitInitializationModeTYPE fmi2ExitInitializationMode;
fmi2TerminateTYPE fmi2Terminate;
fmi2ResetTYPE fmi2Reset;

fmi2GetRealTYPE fmi2GetReal;
fmi2GetIntegerTYPE fmi2GetInteger;
fmi2GetBooleanTYPE fmi2GetBoolean;
fmi2GetStringTYPE fmi2GetString;
fmi2SetRealTYPE fmi2SetReal;
fmi2SetIntegerTYPE fmi2SetInteger;
fmi2SetBooleanTYPE fmi2SetBoolean;
fmi2SetStringTYPE fmi2SetString;

fmi2GetFMUstateTYPE fmi2GetFMUstate;
fmi2SetFMUstateTYPE fmi2SetFMUstate;
fmi2FreeFMUstateTYPE fmi2FreeFMUstate;
fmi2SerializedFMUstateSizeTYPE fmi2SerializedFMUstateSize;
fmi2SerializeFMUstateTYPE fmi2SerializeFMUstate;
fmi2DeSerializeFMUstateTYPE fmi2DeSerializeFMUstate;

fmi2GetDirectionalDerivativeTYPE fmi2GetDirectionalDerivative;

fmi2SetRealInputDerivativesTYPE fmi2SetRealInputDerivatives;
fmi2GetRealOutputDerivativesTYPE fmi2GetRealOutputDerivatives;
fmi2DoStepTYPE fmi2DoStep;
fmi2CancelStepTYPE fmi2CancelStep;

fmi2GetStatusTYPE fmi2GetStatus;
fmi2GetRealStatusTYPE fmi2GetRealStatus;
fmi2GetIntegerStatusTYPE fmi2GetIntegerStatus;
fmi2GetBooleanStatusTYPE fmi2GetBooleanStatus;
fmi2GetStringStatusTYPE fmi2GetStringStatus;

#ifdef __cplusplus
}
#endif

#endif
