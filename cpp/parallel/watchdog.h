// SPDX-License-Identifier: MIT
//
// Ends a job that hangs. A rank may wait in MPI for ever for one that has failed, or that waits
// elsewhere; Python cannot interrupt it there, since PETSc keeps the interpreter to itself. A
// thread of its own can.
#pragma once

#include <string>

namespace dolfinx_contact
{
/// Begin to wait, from now, in place of what was waited for before; or stop waiting.
///
/// When the time is over, the thread sends the calling thread a signal, whose handler writes to a
/// file where that is; writes the text and the file to the standard error, at once, so that ranks
/// do not write between each other's lines; gives the other ranks the time to do the same; and
/// aborts MPI.
///
/// @param seconds after which the job ends; 0: never
/// @param text to write
/// @param signal to send to the thread that has called
/// @param file descriptor of what the handler writes; −1: there is none
/// @param grace seconds between the message and the end
void watch(double seconds, const std::string& text, int signal, int file, double grace);
} // namespace dolfinx_contact
