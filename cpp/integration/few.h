// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <initializer_list>
#include <vector>

namespace dolfinx_contact
{

/// A list that takes no memory from the heap as long as it has at most N members.
template <typename T, std::size_t N>
class Few
{
public:
  Few() = default;
  Few(std::initializer_list<T> list) { append(list); }
  Few(const std::vector<T>& list) { append(list); }

  void push_back(const T& x)
  {
    if (_size < N)
      _few[_size] = x;
    else
    {
      if (_size == N)
        _many.assign(_few.begin(), _few.end());
      _many.push_back(x);
    }
    ++_size;
  }
  void clear()
  {
    _size = 0;
    _many.clear();
  }

  std::size_t size() const { return _size; }
  bool empty() const { return _size == 0; }
  T* begin() { return _size > N ? _many.data() : _few.data(); }
  const T* begin() const { return _size > N ? _many.data() : _few.data(); }
  T* end() { return begin() + _size; }
  const T* end() const { return begin() + _size; }
  T& operator[](std::size_t i) { return begin()[i]; }
  const T& operator[](std::size_t i) const { return begin()[i]; }

private:
  template <typename List>
  void append(const List& list)
  {
    for (const T& x : list)
      push_back(x);
  }

  std::size_t _size = 0;
  std::array<T, N> _few;
  std::vector<T> _many; // all of them, if they are more than N
};

} // namespace dolfinx_contact
