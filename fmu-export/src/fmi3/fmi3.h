/* The C interface of FMI 3.0.
 *
 * The names, their values and their order are those of the standard (FMI 3.0, chapters 2.2 to 5), the comments are ours.
 * scripts/check_header.py compares this file item by item with an independent copy of the interface, and scripts/bindings
 * makes bindings.rs from it.
 */
#ifndef FMI3_H
#define FMI3_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Return value of fmi3GetVersion. */
#define fmi3Version "3.0"

/* Types on which the two sides agree. */

/** One instance of the FMU; opaque to the importer. */
typedef void* fmi3Instance;
/** A pointer of the importer, passed back with every callback; opaque to the FMU. */
typedef void* fmi3InstanceEnvironment;
/** A snapshot of one instance; opaque to the importer. */
typedef void* fmi3FMUState;
/** The number that identifies a variable in calls, unique within the FMU. */
typedef uint32_t fmi3ValueReference;
/** A real number in single precision. */
typedef float fmi3Float32;
/** A real number in double precision, in the variable's unit. */
typedef double fmi3Float64;
/** A whole number of 8 bits. */
typedef int8_t fmi3Int8;
/** A whole number of 8 bits, 0 or above. */
typedef uint8_t fmi3UInt8;
/** A whole number of 16 bits. */
typedef int16_t fmi3Int16;
/** A whole number of 16 bits, 0 or above. */
typedef uint16_t fmi3UInt16;
/** A whole number of 32 bits. */
typedef int32_t fmi3Int32;
/** A whole number of 32 bits, 0 or above. */
typedef uint32_t fmi3UInt32;
/** A whole number of 64 bits, or the value of an enumeration. */
typedef int64_t fmi3Int64;
/** A whole number of 64 bits, 0 or above. */
typedef uint64_t fmi3UInt64;
/** fmi3True or fmi3False. */
typedef bool fmi3Boolean;
/** One byte of a text in UTF-8. */
typedef char fmi3Char;
/** A zero-terminated text in UTF-8; the receiver copies it before the call returns. */
typedef const fmi3Char* fmi3String;
/** One byte of binary data. */
typedef uint8_t fmi3Byte;
/** Binary data, whose size is passed separately. */
typedef const fmi3Byte* fmi3Binary;
/** Whether a clock ticks: fmi3ClockActive or fmi3ClockInactive. */
typedef bool fmi3Clock;

/** The Boolean value true. */
#define fmi3True true
/** The Boolean value false. */
#define fmi3False false
/** A clock that ticks. */
#define fmi3ClockActive true
/** A clock that does not tick. */
#define fmi3ClockInactive false

/* Enumerations. */

/** How a call ended. */
typedef enum {
    /** All is well. */
    fmi3OK,
    /** Something is unusual; the simulation can continue. */
    fmi3Warning,
    /** The call had no effect. */
    fmi3Discard,
    /** The instance cannot continue; other instances can. */
    fmi3Error,
    /** No instance of this FMU can continue. */
    fmi3Fatal
} fmi3Status;

/** How an unknown depends on a known. */
typedef enum {
    /** Not at all. */
    fmi3Independent,
    /** By a constant factor. */
    fmi3Constant,
    /** By a factor that is constant after initialization. */
    fmi3Fixed,
    /** By a factor that changes with tunable parameters. */
    fmi3Tunable,
    /** By a factor that changes at events. */
    fmi3Discrete,
    /** In any way. */
    fmi3Dependent
} fmi3DependencyKind;

/** Whether the interval of a clock is known. */
typedef enum {
    /** Not yet. */
    fmi3IntervalNotYetKnown,
    /** Unchanged. */
    fmi3IntervalUnchanged,
    /** New. */
    fmi3IntervalChanged
} fmi3IntervalQualifier;

/* Callbacks of the importer. */

/** Receives a message. */
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment instanceEnvironment, fmi3Status status,
                                       fmi3String category, fmi3String message);
/** Is called when clocks tick. */
typedef void (*fmi3ClockUpdateCallback)(fmi3InstanceEnvironment instanceEnvironment);
/** Is called within a step, where inputs and outputs may be exchanged. */
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment instanceEnvironment,
                                               fmi3Float64 intermediateUpdateTime,
                                               fmi3Boolean intermediateVariableSetRequested,
                                               fmi3Boolean intermediateVariableGetAllowed,
                                               fmi3Boolean intermediateStepFinished, fmi3Boolean canReturnEarly,
                                               fmi3Boolean* earlyReturnRequested, fmi3Float64* earlyReturnTime);
/** Locks preemption of a model partition. */
typedef void (*fmi3LockPreemptionCallback)(void);
/** Unlocks preemption of a model partition. */
typedef void (*fmi3UnlockPreemptionCallback)(void);

/* Function types, for addresses looked up by importers. */

/* Version and messages. */

/** Returns the version of the standard. */
typedef const char* fmi3GetVersionTYPE(void);
/** Turns messages of the named categories on or off; no categories named means all of them. */
typedef fmi3Status fmi3SetDebugLoggingTYPE(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                                           const fmi3String categories[]);

/* Life of an instance. */

/** Makes an instance for model exchange, or returns a null pointer. */
typedef fmi3Instance fmi3InstantiateModelExchangeTYPE(fmi3String instanceName, fmi3String instantiationToken,
                                                      fmi3String resourcePath, fmi3Boolean visible,
                                                      fmi3Boolean loggingOn,
                                                      fmi3InstanceEnvironment instanceEnvironment,
                                                      fmi3LogMessageCallback logMessage);
/** Makes an instance for co-simulation, or returns a null pointer. */
typedef fmi3Instance fmi3InstantiateCoSimulationTYPE(fmi3String instanceName, fmi3String instantiationToken,
                                                     fmi3String resourcePath, fmi3Boolean visible,
                                                     fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
                                                     fmi3Boolean earlyReturnAllowed,
                                                     const fmi3ValueReference requiredIntermediateVariables[],
                                                     size_t nRequiredIntermediateVariables,
                                                     fmi3InstanceEnvironment instanceEnvironment,
                                                     fmi3LogMessageCallback logMessage,
                                                     fmi3IntermediateUpdateCallback intermediateUpdate);
/** Makes an instance for scheduled execution, or returns a null pointer. */
typedef fmi3Instance fmi3InstantiateScheduledExecutionTYPE(fmi3String instanceName, fmi3String instantiationToken,
                                                           fmi3String resourcePath, fmi3Boolean visible,
                                                           fmi3Boolean loggingOn,
                                                           fmi3InstanceEnvironment instanceEnvironment,
                                                           fmi3LogMessageCallback logMessage,
                                                           fmi3ClockUpdateCallback clockUpdate,
                                                           fmi3LockPreemptionCallback lockPreemption,
                                                           fmi3UnlockPreemptionCallback unlockPreemption);
/** Frees an instance; a null pointer is allowed. */
typedef void fmi3FreeInstanceTYPE(fmi3Instance instance);

/* Modes. */

/** Begins initialization, with tolerance, start and stop time, in seconds. */
typedef fmi3Status fmi3EnterInitializationModeTYPE(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                                   fmi3Float64 tolerance, fmi3Float64 startTime,
                                                   fmi3Boolean stopTimeDefined, fmi3Float64 stopTime);
/** Ends initialization; event mode follows if it is used, else step mode. */
typedef fmi3Status fmi3ExitInitializationModeTYPE(fmi3Instance instance);
/** Begins the handling of an event. */
typedef fmi3Status fmi3EnterEventModeTYPE(fmi3Instance instance);
/** Ends the simulation; results can still be read. */
typedef fmi3Status fmi3TerminateTYPE(fmi3Instance instance);
/** Resets an instance to its initial state. */
typedef fmi3Status fmi3ResetTYPE(fmi3Instance instance);

/* Values of variables. The values of arrays follow one another; nValues counts all of them. */

/** Reads Float32 variables. */
typedef fmi3Status fmi3GetFloat32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, fmi3Float32 values[], size_t nValues);
/** Reads Float64 variables. */
typedef fmi3Status fmi3GetFloat64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, fmi3Float64 values[], size_t nValues);
/** Reads Int8 variables. */
typedef fmi3Status fmi3GetInt8TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, fmi3Int8 values[], size_t nValues);
/** Reads UInt8 variables. */
typedef fmi3Status fmi3GetUInt8TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, fmi3UInt8 values[], size_t nValues);
/** Reads Int16 variables. */
typedef fmi3Status fmi3GetInt16TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, fmi3Int16 values[], size_t nValues);
/** Reads UInt16 variables. */
typedef fmi3Status fmi3GetUInt16TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, fmi3UInt16 values[], size_t nValues);
/** Reads Int32 variables. */
typedef fmi3Status fmi3GetInt32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, fmi3Int32 values[], size_t nValues);
/** Reads UInt32 variables. */
typedef fmi3Status fmi3GetUInt32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, fmi3UInt32 values[], size_t nValues);
/** Reads Int64 variables. */
typedef fmi3Status fmi3GetInt64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, fmi3Int64 values[], size_t nValues);
/** Reads UInt64 variables. */
typedef fmi3Status fmi3GetUInt64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, fmi3UInt64 values[], size_t nValues);
/** Reads Boolean variables. */
typedef fmi3Status fmi3GetBooleanTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, fmi3Boolean values[], size_t nValues);
/** Reads String variables; the texts stay valid until the next call on the same instance. */
typedef fmi3Status fmi3GetStringTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, fmi3String values[], size_t nValues);
/** Reads Binary variables. */
typedef fmi3Status fmi3GetBinaryTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, size_t valueSizes[], fmi3Binary values[], size_t nValues);
/** Reads whether clocks are active. */
typedef fmi3Status fmi3GetClockTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, fmi3Clock values[]);
/** Writes Float32 variables. */
typedef fmi3Status fmi3SetFloat32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, const fmi3Float32 values[], size_t nValues);
/** Writes Float64 variables. */
typedef fmi3Status fmi3SetFloat64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, const fmi3Float64 values[], size_t nValues);
/** Writes Int8 variables. */
typedef fmi3Status fmi3SetInt8TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                   size_t nValueReferences, const fmi3Int8 values[], size_t nValues);
/** Writes UInt8 variables. */
typedef fmi3Status fmi3SetUInt8TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3UInt8 values[], size_t nValues);
/** Writes Int16 variables. */
typedef fmi3Status fmi3SetInt16TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int16 values[], size_t nValues);
/** Writes UInt16 variables. */
typedef fmi3Status fmi3SetUInt16TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, const fmi3UInt16 values[], size_t nValues);
/** Writes Int32 variables. */
typedef fmi3Status fmi3SetInt32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int32 values[], size_t nValues);
/** Writes UInt32 variables. */
typedef fmi3Status fmi3SetUInt32TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, const fmi3UInt32 values[], size_t nValues);
/** Writes Int64 variables. */
typedef fmi3Status fmi3SetInt64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Int64 values[], size_t nValues);
/** Writes UInt64 variables. */
typedef fmi3Status fmi3SetUInt64TYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, const fmi3UInt64 values[], size_t nValues);
/** Writes Boolean variables. */
typedef fmi3Status fmi3SetBooleanTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                      size_t nValueReferences, const fmi3Boolean values[], size_t nValues);
/** Writes String variables. */
typedef fmi3Status fmi3SetStringTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, const fmi3String values[], size_t nValues);
/** Writes Binary variables. */
typedef fmi3Status fmi3SetBinaryTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                     size_t nValueReferences, const size_t valueSizes[], const fmi3Binary values[],
                                     size_t nValues);
/** Activates clocks. */
typedef fmi3Status fmi3SetClockTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                    size_t nValueReferences, const fmi3Clock values[]);

/* Dependencies between variables whose sizes can change. */

/** Counts the dependencies of a variable. */
typedef fmi3Status fmi3GetNumberOfVariableDependenciesTYPE(fmi3Instance instance, fmi3ValueReference valueReference,
                                                           size_t* nDependencies);
/** Reads the dependencies of a variable. */
typedef fmi3Status fmi3GetVariableDependenciesTYPE(fmi3Instance instance, fmi3ValueReference dependent,
                                                   size_t elementIndicesOfDependent[],
                                                   fmi3ValueReference independents[],
                                                   size_t elementIndicesOfIndependents[],
                                                   fmi3DependencyKind dependencyKinds[], size_t nDependencies);

/* Snapshots. */

/** Takes a snapshot: a new one if the pointer is null, else into the existing one. */
typedef fmi3Status fmi3GetFMUStateTYPE(fmi3Instance instance, fmi3FMUState* FMUState);
/** Restores a snapshot, which stays valid. */
typedef fmi3Status fmi3SetFMUStateTYPE(fmi3Instance instance, fmi3FMUState FMUState);
/** Frees a snapshot and sets its pointer to null; a null pointer is allowed. */
typedef fmi3Status fmi3FreeFMUStateTYPE(fmi3Instance instance, fmi3FMUState* FMUState);
/** Returns the size of a serialized snapshot, in bytes. */
typedef fmi3Status fmi3SerializedFMUStateSizeTYPE(fmi3Instance instance, fmi3FMUState FMUState, size_t* size);
/** Writes a snapshot as bytes. */
typedef fmi3Status fmi3SerializeFMUStateTYPE(fmi3Instance instance, fmi3FMUState FMUState, fmi3Byte serializedState[],
                                             size_t size);
/** Makes a snapshot from bytes. */
typedef fmi3Status fmi3DeserializeFMUStateTYPE(fmi3Instance instance, const fmi3Byte serializedState[], size_t size,
                                               fmi3FMUState* FMUState);

/* Derivatives. */

/** Returns the product of the Jacobian of the unknowns with respect to the knowns and a vector. */
typedef fmi3Status fmi3GetDirectionalDerivativeTYPE(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                                    size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns,
                                                    const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
                                                    size_t nSensitivity);
/** Returns the product of a vector and the Jacobian of the unknowns with respect to the knowns. */
typedef fmi3Status fmi3GetAdjointDerivativeTYPE(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                                size_t nUnknowns, const fmi3ValueReference knowns[], size_t nKnowns,
                                                const fmi3Float64 seed[], size_t nSeed, fmi3Float64 sensitivity[],
                                                size_t nSensitivity);

/* Structural parameters. */

/** Starts the change of structural parameters. */
typedef fmi3Status fmi3EnterConfigurationModeTYPE(fmi3Instance instance);
/** Ends the change of structural parameters. */
typedef fmi3Status fmi3ExitConfigurationModeTYPE(fmi3Instance instance);

/* Clocks, and events. */

/** Reads the intervals of clocks, in seconds. */
typedef fmi3Status fmi3GetIntervalDecimalTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                              size_t nValueReferences, fmi3Float64 intervals[],
                                              fmi3IntervalQualifier qualifiers[]);
/** Reads the intervals of clocks, as fractions. */
typedef fmi3Status fmi3GetIntervalFractionTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                               size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                               fmi3IntervalQualifier qualifiers[]);
/** Reads the delays of clocks, in seconds. */
typedef fmi3Status fmi3GetShiftDecimalTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                           size_t nValueReferences, fmi3Float64 shifts[]);
/** Reads the delays of clocks, as fractions. */
typedef fmi3Status fmi3GetShiftFractionTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                            size_t nValueReferences, fmi3UInt64 counters[], fmi3UInt64 resolutions[]);
/** Sets the intervals of clocks, in seconds. */
typedef fmi3Status fmi3SetIntervalDecimalTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                              size_t nValueReferences, const fmi3Float64 intervals[]);
/** Sets the intervals of clocks, as fractions. */
typedef fmi3Status fmi3SetIntervalFractionTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                               size_t nValueReferences, const fmi3UInt64 counters[],
                                               const fmi3UInt64 resolutions[]);
/** Sets the delays of clocks, in seconds. */
typedef fmi3Status fmi3SetShiftDecimalTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                           size_t nValueReferences, const fmi3Float64 shifts[]);
/** Sets the delays of clocks, as fractions. */
typedef fmi3Status fmi3SetShiftFractionTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                            size_t nValueReferences, const fmi3UInt64 counters[],
                                            const fmi3UInt64 resolutions[]);
/** Computes discrete states without ending the event. */
typedef fmi3Status fmi3EvaluateDiscreteStatesTYPE(fmi3Instance instance);
/** Computes discrete states, and reports the consequences of the event. */
typedef fmi3Status fmi3UpdateDiscreteStatesTYPE(fmi3Instance instance, fmi3Boolean* discreteStatesNeedUpdate,
                                                fmi3Boolean* terminateSimulation,
                                                fmi3Boolean* nominalsOfContinuousStatesChanged,
                                                fmi3Boolean* valuesOfContinuousStatesChanged,
                                                fmi3Boolean* nextEventTimeDefined, fmi3Float64* nextEventTime);

/* Model exchange. */

/** Ends the handling of an event in model exchange. */
typedef fmi3Status fmi3EnterContinuousTimeModeTYPE(fmi3Instance instance);
/** Reports a completed step of the importer's integrator. */
typedef fmi3Status fmi3CompletedIntegratorStepTYPE(fmi3Instance instance, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                                   fmi3Boolean* enterEventMode, fmi3Boolean* terminateSimulation);
/** Sets the time. */
typedef fmi3Status fmi3SetTimeTYPE(fmi3Instance instance, fmi3Float64 time);
/** Sets the continuous states. */
typedef fmi3Status fmi3SetContinuousStatesTYPE(fmi3Instance instance, const fmi3Float64 continuousStates[],
                                               size_t nContinuousStates);
/** Reads the derivatives of the continuous states. */
typedef fmi3Status fmi3GetContinuousStateDerivativesTYPE(fmi3Instance instance, fmi3Float64 derivatives[],
                                                         size_t nContinuousStates);
/** Reads the event indicators. */
typedef fmi3Status fmi3GetEventIndicatorsTYPE(fmi3Instance instance, fmi3Float64 eventIndicators[],
                                              size_t nEventIndicators);
/** Reads the continuous states. */
typedef fmi3Status fmi3GetContinuousStatesTYPE(fmi3Instance instance, fmi3Float64 continuousStates[],
                                               size_t nContinuousStates);
/** Reads the nominal values of the continuous states. */
typedef fmi3Status fmi3GetNominalsOfContinuousStatesTYPE(fmi3Instance instance, fmi3Float64 nominals[],
                                                         size_t nContinuousStates);
/** Counts the event indicators. */
typedef fmi3Status fmi3GetNumberOfEventIndicatorsTYPE(fmi3Instance instance, size_t* nEventIndicators);
/** Counts the continuous states. */
typedef fmi3Status fmi3GetNumberOfContinuousStatesTYPE(fmi3Instance instance, size_t* nContinuousStates);

/* Co-simulation. */

/** Ends the handling of an event in co-simulation. */
typedef fmi3Status fmi3EnterStepModeTYPE(fmi3Instance instance);
/** Reads time derivatives of outputs, of the given orders (1 is the first derivative). */
typedef fmi3Status fmi3GetOutputDerivativesTYPE(fmi3Instance instance, const fmi3ValueReference valueReferences[],
                                                size_t nValueReferences, const fmi3Int32 orders[], fmi3Float64 values[],
                                                size_t nValues);
/** Steps from a time by a step size, both in seconds. */
typedef fmi3Status fmi3DoStepTYPE(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                                  fmi3Float64 communicationStepSize, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                  fmi3Boolean* eventHandlingNeeded, fmi3Boolean* terminateSimulation,
                                  fmi3Boolean* earlyReturn, fmi3Float64* lastSuccessfulTime);

/* Scheduled execution. */

/** Computes the model partition of a clock. */
typedef fmi3Status fmi3ActivateModelPartitionTYPE(fmi3Instance instance, fmi3ValueReference clockReference,
                                                  fmi3Float64 activationTime);

/* The functions that the FMU exports. */

fmi3GetVersionTYPE fmi3GetVersion;
fmi3SetDebugLoggingTYPE fmi3SetDebugLogging;

fmi3InstantiateModelExchangeTYPE fmi3InstantiateModelExchange;
fmi3InstantiateCoSimulationTYPE fmi3InstantiateCoSimulation;
fmi3InstantiateScheduledExecutionTYPE fmi3InstantiateScheduledExecution;
fmi3FreeInstanceTYPE fmi3FreeInstance;

fmi3EnterInitializationModeTYPE fmi3EnterInitializationMode;
fmi3ExitInitializationModeTYPE fmi3ExitInitializationMode;
fmi3EnterEventModeTYPE fmi3EnterEventMode;
fmi3TerminateTYPE fmi3Terminate;
fmi3ResetTYPE fmi3Reset;

fmi3GetFloat32TYPE fmi3GetFloat32;
fmi3GetFloat64TYPE fmi3GetFloat64;
fmi3GetInt8TYPE fmi3GetInt8;
fmi3GetUInt8TYPE fmi3GetUInt8;
fmi3GetInt16TYPE fmi3GetInt16;
fmi3GetUInt16TYPE fmi3GetUInt16;
fmi3GetInt32TYPE fmi3GetInt32;
fmi3GetUInt32TYPE fmi3GetUInt32;
fmi3GetInt64TYPE fmi3GetInt64;
fmi3GetUInt64TYPE fmi3GetUInt64;
fmi3GetBooleanTYPE fmi3GetBoolean;
fmi3GetStringTYPE fmi3GetString;
fmi3GetBinaryTYPE fmi3GetBinary;
fmi3GetClockTYPE fmi3GetClock;
fmi3SetFloat32TYPE fmi3SetFloat32;
fmi3SetFloat64TYPE fmi3SetFloat64;
fmi3SetInt8TYPE fmi3SetInt8;
fmi3SetUInt8TYPE fmi3SetUInt8;
fmi3SetInt16TYPE fmi3SetInt16;
fmi3SetUInt16TYPE fmi3SetUInt16;
fmi3SetInt32TYPE fmi3SetInt32;
fmi3SetUInt32TYPE fmi3SetUInt32;
fmi3SetInt64TYPE fmi3SetInt64;
fmi3SetUInt64TYPE fmi3SetUInt64;
fmi3SetBooleanTYPE fmi3SetBoolean;
fmi3SetStringTYPE fmi3SetString;
fmi3SetBinaryTYPE fmi3SetBinary;
fmi3SetClockTYPE fmi3SetClock;

fmi3GetNumberOfVariableDependenciesTYPE fmi3GetNumberOfVariableDependencies;
fmi3GetVariableDependenciesTYPE fmi3GetVariableDependencies;

fmi3GetFMUStateTYPE fmi3GetFMUState;
fmi3SetFMUStateTYPE fmi3SetFMUState;
fmi3FreeFMUStateTYPE fmi3FreeFMUState;
fmi3SerializedFMUStateSizeTYPE fmi3SerializedFMUStateSize;
fmi3SerializeFMUStateTYPE fmi3SerializeFMUState;
fmi3DeserializeFMUStateTYPE fmi3DeserializeFMUState;

fmi3GetDirectionalDerivativeTYPE fmi3GetDirectionalDerivative;
fmi3GetAdjointDerivativeTYPE fmi3GetAdjointDerivative;

fmi3EnterConfigurationModeTYPE fmi3EnterConfigurationMode;
fmi3ExitConfigurationModeTYPE fmi3ExitConfigurationMode;

fmi3GetIntervalDecimalTYPE fmi3GetIntervalDecimal;
fmi3GetIntervalFractionTYPE fmi3GetIntervalFraction;
fmi3GetShiftDecimalTYPE fmi3GetShiftDecimal;
fmi3GetShiftFractionTYPE fmi3GetShiftFraction;
fmi3SetIntervalDecimalTYPE fmi3SetIntervalDecimal;
fmi3SetIntervalFractionTYPE fmi3SetIntervalFraction;
fmi3SetShiftDecimalTYPE fmi3SetShiftDecimal;
fmi3SetShiftFractionTYPE fmi3SetShiftFraction;
fmi3EvaluateDiscreteStatesTYPE fmi3EvaluateDiscreteStates;
fmi3UpdateDiscreteStatesTYPE fmi3UpdateDiscreteStates;

fmi3EnterContinuousTimeModeTYPE fmi3EnterContinuousTimeMode;
fmi3CompletedIntegratorStepTYPE fmi3CompletedIntegratorStep;
fmi3SetTimeTYPE fmi3SetTime;
fmi3SetContinuousStatesTYPE fmi3SetContinuousStates;
fmi3GetContinuousStateDerivativesTYPE fmi3GetContinuousStateDerivatives;
fmi3GetEventIndicatorsTYPE fmi3GetEventIndicators;
fmi3GetContinuousStatesTYPE fmi3GetContinuousStates;
fmi3GetNominalsOfContinuousStatesTYPE fmi3GetNominalsOfContinuousStates;
fmi3GetNumberOfEventIndicatorsTYPE fmi3GetNumberOfEventIndicators;
fmi3GetNumberOfContinuousStatesTYPE fmi3GetNumberOfContinuousStates;

fmi3EnterStepModeTYPE fmi3EnterStepMode;
fmi3GetOutputDerivativesTYPE fmi3GetOutputDerivatives;
fmi3DoStepTYPE fmi3DoStep;

fmi3ActivateModelPartitionTYPE fmi3ActivateModelPartition;

#ifdef __cplusplus
}
#endif

#endif
