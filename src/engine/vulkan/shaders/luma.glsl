/* SPDX-License-Identifier: Apache-2.0 */
const float luma[3] = {0.299, 0.587, 0.114};
