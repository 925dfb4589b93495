// Memory that is kept from one use to the next; its content is not.
#pragma once

#include <cstddef>
#include <memory>

template <class Value> class Buffer {
public:
    // Room for `count` values, which are not initialised. Grows only.
    Value* reserve(size_t count)
    {
        if (count > capacity) {
            data.reset(), capacity = 0; // before the larger one is allocated: never both
            data = std::make_unique_for_overwrite<Value[]>(count);
            capacity = count;
        }
        return data.get();
    }

    Value* get() const { return data.get(); }
    size_t byte_count() const { return capacity * sizeof(Value); }

private:
    std::unique_ptr<Value[]> data;
    size_t capacity = 0;
};
