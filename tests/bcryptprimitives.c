/* bcryptprimitives.dll for Wine before version 9, which lacks it: Rust's standard library takes random numbers
 * from it. Every Windows version that Rust supports has it. */

#include <windows.h>
#include <ntsecapi.h>

__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length)
{
    return RtlGenRandom(data, (ULONG)length);
}
