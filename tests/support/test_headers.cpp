// SPDX-License-Identifier: GPL-3.0-or-later
// Nothing: the target of this file carries the precompiled headers of the tests.
