/* The library bcryptprimitives.dll for releases of Wine before 9, which lack it: Rust's standard library takes random numbers
 * from it. Every Windows that Rust supports has it. */

#include <windows.h>
#include <ntsecapi.h>

__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length)
{
    return RtlGenRandom(data, (ULONG)length);
}
